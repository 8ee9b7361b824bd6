"""Measurements of this machine, each a ratio within one run or a percentile; nothing is asserted here."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from hilbridge.bench_prediction import PAPERS_SIZE, drawn_vectors, of_size, prediction_cost
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.quick_can import can
from hilbridge.bus.simulated.client import BusClient, Rates
from hilbridge.bus.simulated.interface import Network, SimulatedBus
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.core.gate import GateConfig
from hilbridge.intent.bundle import Bundle, demo_bundle_path, load_bundle
from hilbridge.intent.predictor import Predictor
from hilbridge.intent.tremor import TremorGuard
from hilbridge.lease import leased
from hilbridge.limits import FREEZE_LIMIT_MS, MS, SENSOR_TIMEOUT_MS
from hilbridge.observe.summary import percentile
from hilbridge.records import FeatureVector
from hilbridge.runtime.health import SensorSeen
from hilbridge.runtime.node import BridgeNode
from hilbridge.wire.codec import Codec
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator


@dataclass(frozen=True, slots=True)
class BenchResult:
    """predict_step: one 25 Hz step of the numpy engine, features in, calibrated estimate out. torch_window, onnx_window: one
    forward pass over the whole 2 s window (None where it is not installed). product: the matrix product of a step, alone.
    256: the same at the paper's size, with drawn weights. tick_overhead: everything of a tick but prediction.
    """

    predict_step_ms_p50: float
    torch_window_ms_p50: float | None
    predict_ratio: float | None
    predict_to_onnx: float | None
    predict_to_product: float
    predict_256_step_ms_p50: float
    predict_256_to_torch: float | None
    predict_256_to_onnx: float | None
    predict_256_to_product: float
    tick_overhead_ms_p99: float
    wire_encode_us: float
    wire_decode_us: float
    import_s: float
    rss_mb: float | None

    def as_json(self) -> dict[str, Any]:
        return {name: None if v is None else round(v, 4) for name, v in asdict(self).items()}


def run_bench(repeats: int = 400, show: Callable[[str], None] = lambda text: None) -> BenchResult:
    """Measure all of it; takes some ten seconds."""
    show("importing in a fresh process")
    import_s = _import_s()
    bundle = load_bundle(demo_bundle_path())
    show("prediction against torch, ONNX Runtime and its matrix product, in turn")
    shipped = prediction_cost(bundle, repeats)
    wide = prediction_cost(of_size(bundle, PAPERS_SIZE), repeats)
    show("tick and codec")
    overhead_ms = _tick_overhead_ms(bundle, repeats)
    encode_us, decode_us = _codec_us(repeats * 10)
    return BenchResult(
        predict_step_ms_p50=shipped.step_ms,
        torch_window_ms_p50=shipped.torch_ms,
        predict_ratio=_ratio(shipped.step_ms, shipped.torch_ms),
        predict_to_onnx=_ratio(shipped.step_ms, shipped.onnx_ms),
        predict_to_product=shipped.step_ms / shipped.product_ms,
        predict_256_step_ms_p50=wide.step_ms,
        predict_256_to_torch=_ratio(wide.step_ms, wide.torch_ms),
        predict_256_to_onnx=_ratio(wide.step_ms, wide.onnx_ms),
        predict_256_to_product=wide.step_ms / wide.product_ms,
        tick_overhead_ms_p99=percentile(overhead_ms, 0.99) or 0.0,
        wire_encode_us=encode_us,
        wire_decode_us=decode_us,
        import_s=import_s,
        rss_mb=_peak_mb(),
    )


def _ratio(step_ms: float, other_ms: float | None) -> float | None:
    return None if other_ms is None else step_ms / other_ms


def _peak_mb() -> float | None:
    """The most memory that this process had; None where the system does not count it."""
    try:
        import resource
    except ImportError:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


def _tick_overhead_ms(bundle: Bundle, repeats: int) -> list[float]:
    class Echo:
        def __init__(self) -> None:
            self.inner = Predictor(bundle)
            self.spent_s = 0.0

        def step(self, vector: FeatureVector, produced_ns: int) -> Any:
            begin = time.perf_counter()
            estimate = self.inner.step(vector, produced_ns)
            self.spent_s += time.perf_counter() - begin
            return estimate

        def reset(self) -> None:
            self.inner.reset()

    predict = Echo()
    wire = WireLink(Codec())
    bridge = Bridge(wire, Authenticator(DEMO_KEY), lambda: 1, BridgeConfig(), lambda: wire.counters)
    node = BridgeNode(predict, GateConfig(0.8, 0.6), bridge, wire, bundle.bundle_id, TremorGuard())
    spent = []
    for vector in drawn_vectors(repeats):
        now_ns = vector.captured_ns + 5 * MS
        seen = SensorSeen(
            "camera", True, vector.captured_ns, vector.captured_ns, SENSOR_TIMEOUT_MS * MS, FREEZE_LIMIT_MS * MS
        )
        predict.spent_s = 0.0
        begin = time.perf_counter()
        node.tick(vector, (seen,), now_ns)
        spent.append((time.perf_counter() - begin - predict.spent_s) * 1e3)
    return spent


def _codec_us(repeats: int) -> tuple[float, float]:
    wire, peer = WireLink(Codec()), WireLink(Codec(), node="CONTROLLER")
    command: dict[str, int | float | str] = {
        "Gate": "Act",
        "Verb": "Take",
        "Confidence": 93,
        "Session": 7,
        "Echo": 9,
        "SensingAge": 40,
    }
    begin = time.perf_counter()
    frames = [wire.encode("ACT_CMD", command) for _ in range(repeats)]
    encode = time.perf_counter() - begin
    begin = time.perf_counter()
    for frame in frames:
        peer.decode(frame)
    return encode / repeats * 1e6, (time.perf_counter() - begin) / repeats * 1e6


def _import_s() -> float:
    """Time in which a fresh interpreter gets as far as a running bridge needs, less the bare interpreter's own."""
    times = []
    for code in ("pass", "import hilbridge.run, hilbridge.runtime.senses"):
        begin = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        times.append(time.perf_counter() - begin)
    return times[1] - times[0]


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


def bus_in_process(frames: int = 20_000, repeats: int = 5) -> dict[str, float]:
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


def bus_across_processes(trips: int = 500, bitrate: int = 1_000_000, payload: bytes = b"12345678") -> dict[str, float]:
    """Round trip (there, an answer of another process, back) over the simulated bus, wire time included."""
    name = f"bench-{uuid.uuid4()}"
    client = BusClient(name, rates=Rates(bitrate))
    child = subprocess.Popen(leased([sys.executable, "-c", _ECHO, name]), stdout=subprocess.PIPE)
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
        child.terminate()
        child.wait()
        if child.stdout is not None:
            child.stdout.close()
    times_ms.sort()
    return {
        "bus_round_trip_ms_p50": statistics.median(times_ms),
        "bus_round_trip_ms_p99": times_ms[len(times_ms) * 99 // 100],
        "bus_round_trip_bitrate": bitrate,
    }
