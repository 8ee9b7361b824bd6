"""Figures of the simulated bus for `hilbridge bench`: cost of a frame in process, round trip across processes."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
import uuid

import can

from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.simulated.client import BusClient
from hilbridge.bus.simulated.interface import Network, SimulatedBus

_ECHO = (
    "import sys\n"
    "from hilbridge.bus.simulated.client import BusClient\n"
    "from hilbridge.bus.model.frames import WireFrame\n"
    "client = BusClient(sys.argv[1])\n"
    "print('ready', flush=True)\n"
    "while client.wait_readable(20.0):\n"
    "    arrival = client.receive()\n"
    "    if arrival is not None and arrival.frame.can_id == 0x100:\n"
    "        client.send(WireFrame(0x101, arrival.frame.data))\n"
)


def frame_cost_us(one: can.BusABC, other: can.BusABC, frames: int) -> float:
    """CPU time to send one frame on `one` and receive it on `other`, in microseconds."""
    messages = [
        can.Message(arbitration_id=0x060 + number % 4, data=bytes([number] * 8), is_extended_id=False)
        for number in range(256)
    ]
    begin = time.process_time()
    for number in range(frames):
        one.send(messages[number & 255])
        if other.recv(1.0) is None:
            raise RuntimeError("a frame was lost in a bus that loses none")
    return (time.process_time() - begin) / frames * 1e6


def in_process(frames: int = 20_000, repeats: int = 5) -> dict[str, float]:
    """Cost of a frame on python-can's virtual bus and on the simulated one, alternating, the best of each."""
    virtual, simulated = [], []
    for _ in range(repeats):
        with (
            can.Bus(interface="virtual", channel="bench") as one,
            can.Bus(interface="virtual", channel="bench") as other,
        ):
            virtual.append(frame_cost_us(one, other, frames))
        network = Network()
        with SimulatedBus(network) as one, SimulatedBus(network) as other:
            simulated.append(frame_cost_us(one, other, frames))
    return {
        "bus_virtual_us": min(virtual),
        "bus_simulated_us": min(simulated),
        "bus_speed_ratio": min(virtual) / min(simulated),
    }


def across_processes(trips: int = 500, bitrate: int = 1_000_000, payload: bytes = b"12345678") -> dict[str, float]:
    """Round trip (there, an answer of another process, back) over the simulated bus, wire time included."""
    name = f"bench-{uuid.uuid4()}"
    client = BusClient(name, bitrate=bitrate)
    child = subprocess.Popen([sys.executable, "-c", _ECHO, name], stdout=subprocess.PIPE)
    times_ms = []
    try:
        assert child.stdout is not None
        child.stdout.readline()
        for _ in range(trips):
            begin = time.perf_counter()
            client.send(WireFrame(0x100, payload))
            arrival = None
            while arrival is None and client.wait_readable(5.0):
                arrival = client.receive()
            if arrival is None:
                raise RuntimeError("no answer from the other process")
            times_ms.append((time.perf_counter() - begin) * 1e3)
    finally:
        client.close()
        child.kill()
        child.wait()
        if child.stdout is not None:
            child.stdout.close()
    times_ms.sort()
    return {
        "bus_round_trip_ms_p50": statistics.median(times_ms),
        "bus_round_trip_ms_p99": times_ms[len(times_ms) * 99 // 100],
        "bus_round_trip_bitrate": bitrate,
    }


def measure() -> dict[str, float]:
    """All figures of this module."""
    return in_process() | across_processes()
