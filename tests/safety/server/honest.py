"""An honest pair of clients on a bus under attack: one frame there and one back, and a question to the bus, over and over.

`python -m tests.safety.server.honest NAME [questions]` measures until its standard input ends, then prints one JSON object;
with `questions` no frames, for a bus on which none can pass.
"""

from __future__ import annotations

import json
import select
import sys
import time

from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.simulated.client import BusClient
from hilbridge.priority import use_realtime_scheduling

PING, PONG = (
    WireFrame(0x001, b"ping ..."),
    WireFrame(0x002, b"pong ..."),
)  # more urgent than anything that attackers send
_PAUSE_S = 0.005
_PATIENCE_S = 5.0
_READS = 64


def take(pair: tuple[BusClient, BusClient], reader: BusClient, wanted: WireFrame) -> bool:
    """Whether `reader` gets this frame; both read whatever others send, as clients do that live on a bus."""
    until_s = time.monotonic() + _PATIENCE_S
    while (left_s := until_s - time.monotonic()) > 0:
        for client in select.select(pair, [], [], left_s)[0]:
            for _ in range(_READS):  # a bus under attack is a full one
                arrival = client.receive()
                if arrival is None:
                    break
                if client is reader and arrival.frame == wanted:
                    return True
    return False


def drain(pair: tuple[BusClient, BusClient]) -> None:
    """Pass over what others have sent meanwhile."""
    for client in pair:
        while client.receive() is not None:
            pass


def frame_trip_ms(one: BusClient, other: BusClient) -> float | None:
    """There and back in ms; None where it has not come back."""
    pair = one, other
    drain(pair)
    began_s = time.monotonic()
    one.send(PING, _PATIENCE_S)
    if not take(pair, other, PING):
        return None
    other.send(PONG, _PATIENCE_S)
    return (time.monotonic() - began_s) * 1e3 if take(pair, one, PONG) else None


def question_ms(client: BusClient) -> float | None:
    """How long the bus's answer took, in ms."""
    began_s = time.monotonic()
    try:
        client.control({"op": "recover"}, _PATIENCE_S)
    except OSError:
        return None
    return (time.monotonic() - began_s) * 1e3


def summary(times: list[float | None]) -> dict[str, float]:
    """Count, losses, and the 99th of a hundred, in ms."""
    good = sorted(time_ms for time_ms in times if time_ms is not None)
    at = lambda share: good[min(len(good) - 1, int(len(good) * share))] if good else float("inf")  # noqa: E731 - used twice
    return {"count": len(times), "lost": len(times) - len(good), "p50_ms": at(0.5), "p99_ms": at(0.99)}


def main(name: str, *, with_frames: bool) -> None:
    """Measure until nobody wants more."""
    use_realtime_scheduling()  # as the bridge and the device do
    one, other = BusClient(name, node="honest one", start=False), BusClient(name, node="honest other", start=False)
    frames: list[float | None] = []
    questions: list[float | None] = []
    print("attached", flush=True)
    while not select.select([sys.stdin], [], [], _PAUSE_S)[0]:
        if with_frames:
            frames.append(frame_trip_ms(one, other))
        drain((one, other))
        questions.append(question_ms(one))
    print(json.dumps({"frames": summary(frames), "questions": summary(questions)}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], with_frames="questions" not in sys.argv[2:])
