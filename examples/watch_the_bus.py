"""A node that only listens: the bridge's commands and the device's state in words, from any bus python-can knows."""

import sys

import can

from hilbridge.api import Codec, Frame
from hilbridge.wire.codec import Decoded

WATCHED = ("ACT_CMD", "CTRL_STATUS", "STOP")


def main(bus: str = "vcan0", frames: int = 100) -> None:
    codec = Codec(None)  # the DBC that ships
    interface, _, channel = bus.partition(":") if ":" in bus else ("socketcan", ":", bus)
    before: dict[str, dict[str, object]] = {}
    with can.Bus(interface=interface, channel=channel) as link:
        while frames > 0:
            message = link.recv(timeout=5.0)
            if message is None:
                print("nobody speaks")
                return
            said = codec.decode(Frame(message.arbitration_id, bytes(message.data)))
            if not isinstance(said, Decoded) or said.name not in WATCHED:
                continue
            shown = {name: said.signals[name] for name in ("Gate", "Verb", "State", "Reason") if name in said.signals}
            if shown != before.get(said.name):
                print(said.name, shown, flush=True)
            before[said.name] = shown
            frames -= 1


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:3]))
