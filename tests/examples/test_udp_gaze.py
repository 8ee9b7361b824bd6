"""examples/udp_gaze.py: what it sends is taken, and its clock is known."""

from __future__ import annotations

import importlib.util
import threading
from pathlib import Path

from hilbridge.records import GazeSample, StampSource
from hilbridge.sensors.live.udp import UdpGaze

EXAMPLE = Path(__file__).parents[2] / "examples" / "udp_gaze.py"


def test_the_example_is_taken_and_short() -> None:
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) <= 30
    spec = importlib.util.spec_from_file_location("udp_gaze", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    source = UdpGaze(0)
    good = threading.Event()

    def look(sample: GazeSample) -> None:
        if sample.valid and sample.stamp is StampSource.HARDWARE:
            good.set()

    source.on_value = look
    source.start()
    sender = threading.Thread(target=module.main, args=("127.0.0.1", source.port, 60.0), daemon=True)
    sender.start()
    assert good.wait(60)
    source.stop()
