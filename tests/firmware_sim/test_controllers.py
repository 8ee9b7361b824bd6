"""Powering on and stepping either controller, in a device and in the process."""

from __future__ import annotations

import pytest

from firmware_sim import controllers, device, node
from firmware_sim.c import binding
from firmware_sim.controllers import ControllerUnusable, name_of, power_on
from firmware_sim.secoc import DEMO_KEY
from firmware_sim.watchdogs import Limits

built = pytest.mark.skipif(not binding.available(), reason="the C controller is not built")


@built
def test_a_device_with_the_c_does_as_one_with_the_reference() -> None:
    ours, theirs = (device.Device(power_on(name, DEMO_KEY, 7), "sway") for name in ("python", "c"))
    for number in range(700):
        assert ours.tick((), number) == theirs.tick((), number)
        assert ours.record() == theirs.record()
    limits = Limits(speed_limit_mdeg_s=300_000)
    theirs.state = power_on("c", DEMO_KEY, 7, limits)
    theirs.start_anew(DEMO_KEY, 9)
    assert name_of(theirs.state) == "c"
    assert (theirs.state.boot_nonce, theirs.state.limits) == (9, limits)


@pytest.mark.parametrize(
    ("native", "why"), [(None, "install a C compiler"), (type("Old", (), {"DIGEST": "other"}), "built from other sources")]
)  # fmt: skip
def test_a_build_that_is_not_there_or_of_other_sources_is_not_used(
    native: object, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(binding, "_native", native)
    assert controllers.quickest() == "python"
    with pytest.raises(ControllerUnusable, match=why):
        power_on("c", DEMO_KEY, 1)


def test_the_process_says_in_one_line_that_it_is_not_built(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(binding, "_native", None)
    monkeypatch.setattr(node, "use_realtime_scheduling", lambda: None)
    assert node.main(["--bus", "virtual:controllers", "--controller", "c", "--seconds", "0.1"]) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1
    assert "controller 'c': not built: install a C compiler" in told[0]
