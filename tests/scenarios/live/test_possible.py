"""hilscenario.live.possible: what cannot be had live is refused in one line with its place."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from hilbridge.bus.port.spec import parse_spec
from hilbridge.errors import InputError
from hilbridge.intent.provenance import Origin
from hilscenario.live import possible
from hilscenario.live.possible import impossible_live
from tests.scenarios.made import CATALOG, refused, scenario

VCAN, HILSIM = parse_spec("vcan0"), parse_spec("hilsim:x")


@pytest.mark.parametrize(
    ("given", "location", "said", "on_hilsim"),
    [
        ({"steps": [{"fault": "bus.cut", "at": "1 ms"}]}, ("steps", 0, "fault"), "needs a wire", False),
        ({"steps": [{"fault": "bus.bus_off", "at": "1 ms"}]}, ("steps", 0, "fault"), "needs a wire", False),
        ({"steps": [{"fault": "bus.babble", "at": "1 ms"}]}, ("steps", 0, "fault"), "needs a wire", False),
        ({"bus": {"bitrate": 125000}}, ("bus", "bitrate"), "no bit rate", False),
        ({"bus": {"bit_error_rate": 1e-5}}, ("bus", "bit_error_rate"), "no bits", False),
        ({"device": {"clock_ppm": 100}}, ("device", "clock_ppm"), "this computer's clock", True),
        ({"intent": {"features": "a.npz"}}, ("intent", "features"), "give `video` and `gaze`", True),
    ],
)
def test_what_cannot_be_had_live_is_told_with_its_place_and_why(
    given: dict[str, Any], location: tuple[Any, ...], said: str, on_hilsim: bool
) -> None:
    cannot = impossible_live(scenario(**given), VCAN)
    assert cannot is not None
    assert cannot.location == location
    assert said in cannot.why
    assert (impossible_live(scenario(**given), HILSIM) is not None) == on_hilsim
    assert impossible_live(scenario(), VCAN) is None


def test_a_file_that_cannot_run_live_is_one_line_with_file_and_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = CATALOG / "bus-cut.yaml"
    line = 1 + next(n for n, text in enumerate(path.read_text().splitlines()) if "fault: bus.cut" in text)
    error = refused(monkeypatch, capsys, str(path), "--live", "--bus", "vcan0")
    assert error.startswith(
        f"hilscenario: {path}:{line}: `bus.cut` needs a wire that can be broken or full, vcan0 has none"
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--live", "--bus", "can0"], "--bus can0: may reach a wire, and live scenarios inject faults"),
        (["--live", "--bus", "slcan:/dev/ttyACM0"], "may reach a wire"),
        (["--live", "--bus", "can0", "--i-am-on-a-bench"], "--i-am-on-a-bench: is for a device of yours"),
        (["--live", "--bus", "can0", "--device", "external"], "take the device off, then say --i-am-on-a-bench"),
        (["--live", "--bus", "can0", "--device", "external", "--i-am-on-a-bench"], "the demo key is public"),
        (["--bus", "vcan0"], "--bus vcan0: virtual time has a bus of its own; add --live"),
        (["--live", "--bus", "hilsim:x", "--profile"], "--profile"),
        (["--live", "--bus", ":"], "write auto"),
        (["--live", "--bus", "vcan93"], "hilsim:demo"),
    ],
)
def test_a_bus_that_will_not_do_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert said in refused(monkeypatch, capsys, str(CATALOG / "dropout-gaze-off.yaml"), *words)


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        (Origin.SIMULATED, True),
        (Origin.RECORDED, False),
        (None, False),
    ],
)
def test_a_physical_bus_is_for_a_bench_and_a_bundle_of_simulated_people(
    origin: Origin | None, allowed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        possible, "bundle", lambda: SimpleNamespace(provenance=origin and SimpleNamespace(origin=origin))
    )
    asked = {"live": True, "profile": False, "external": True}
    if allowed:
        assert str(possible.live_bus("can0", **asked, on_a_bench=True)) == "can0"
    else:
        with pytest.raises(InputError, match="only one of simulated people is for a bench"):
            possible.live_bus("can0", **asked, on_a_bench=True)
    for wrong in ({"on_a_bench": False}, {"on_a_bench": True, "external": False}):
        with pytest.raises(InputError):
            possible.live_bus("can0", **{**asked, **wrong})
