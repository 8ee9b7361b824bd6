"""Powering on and stepping either controller, in a device and in the process."""

from __future__ import annotations

import random

import pytest

from firmware_sim import controllers, device, node
from firmware_sim.assist_profile import Profiles
from firmware_sim.bench.remote import RemoteDevice
from firmware_sim.c import binding
from firmware_sim.c.flat import flat
from firmware_sim.controllers import ControllerUnusable, name_of, power_on
from firmware_sim.frames import Reject
from firmware_sim.memory import COUNT_TX_DROPPED
from firmware_sim.plant.arm import WEARERS
from firmware_sim.profile_file import kinds_in, profiles_of
from firmware_sim.profiles import shipped
from firmware_sim.secoc import DEMO_KEY
from firmware_sim.states import State
from firmware_sim.watchdogs import Limits
from tests.safety import hand

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


def _own() -> Profiles:
    """Reaches without damping, and Pour never."""
    kinds = {kind.name: kind for kind in kinds_in()}
    still = kinds["reach"].profile._replace(damping=0, damping_near=0, gravity_per_mille=0)
    kinds["reach"] = kinds["reach"]._replace(profile=still)
    del kinds["pour"]
    return profiles_of(kinds.values())


def _assisting(profiles: Profiles | None) -> hand.Hand:
    return hand.Hand(power_on("python", DEMO_KEY, hand.BOOT_NONCE, profiles=profiles)).to_assist().run(60)


def test_a_device_assists_by_the_profiles_it_was_given() -> None:
    worked = hand.Hand(power_on("python", DEMO_KEY, hand.BOOT_NONCE, profiles=_own())).to_ready()
    worked.beat(*worked.act(hand.POUR))
    assert worked.state.counters[Reject.VERB] == 1
    usual, own = _assisting(None).state, _assisting(_own()).state
    assert (usual.state, own.state) == (State.ASSIST, State.ASSIST)
    assert usual.torque.gravity_unm > 0
    assert own.torque.gravity_unm == 0


def test_a_device_that_starts_anew_keeps_its_profiles() -> None:
    near, remote = (made(power_on("python", DEMO_KEY, 7, profiles=_own())) for made in (device.Device, RemoteDevice))
    for one in (near, remote):
        one.start_anew(DEMO_KEY, 9)
        assert one.state.profiles == _own()


@built
def test_the_c_has_its_profiles_compiled_in_and_takes_no_others() -> None:
    assert power_on("c", DEMO_KEY, 1, profiles=shipped()).profiles == shipped()
    with pytest.raises(ControllerUnusable, match=r"compiled in; use --controller python, or .*firmware_sim.c.generate"):
        power_on("c", DEMO_KEY, 1, profiles=_own())


@built
@pytest.mark.parametrize("wearer", WEARERS)
def test_ticks_made_at_once_are_those_made_one_by_one_to_the_last_bit(wearer: str) -> None:
    chance = random.Random(wearer)
    assisting = hand.Hand().to_assist(hand.POUR).state
    slow, quick = (device.Device(power_on(name, DEMO_KEY, 7), wearer) for name in ("python", "c"))
    slow.state = assisting
    quick.state.load(flat(assisting))  # type: ignore[attr-defined]  # a state of C
    slow.skipped_ms = quick.skipped_ms = assisting.last_tick_ms
    pushed = 0
    while quick.ticks < 3000:
        if chance.random() < 0.02:
            slow.wearer_extra_nm = quick.wearer_extra_nm = chance.uniform(-9.0, 9.0)  # into the stops, too
            lag_s, bias_nm = chance.uniform(0.001, 0.05), chance.choice((0.0, -9.0, 9.0))
            for one in (slow, quick):
                one.break_motor(lag_s=lag_s, bias_nm=bias_nm)
                one.encoder_offset_mdeg = chance.choice((0, 0, 4_000)) if one is slow else slow.encoder_offset_mdeg
        sent, path = quick.coast(chance.randrange(1, 30))
        rows = [path[at : at + device.ROW] for at in range(0, len(path), device.ROW)]
        pushed += sum(row[2] != 0 for row in rows[:-1])
        for row in rows:
            told = slow.tick((), 5)
            law = slow.state.torque
            assert row == (slow.arm.angle, slow.arm.velocity, law.assist_unm, law.gravity_unm)
            assert told == (sent if row is rows[-1] else ())
        assert quick.state.dump() == flat(slow.state)
        assert (quick.actuator, quick.peak_assist_unm) == (slow.actuator, slow.peak_assist_unm)
    assert slow.arm == quick.arm
    assert pushed > 20  # several with torque at once, too


@pytest.mark.parametrize("name", ["python", pytest.param("c", marks=built)])
def test_ticks_are_made_one_by_one_where_something_has_to_be_heard(name: str) -> None:
    one = device.Device(power_on(name, DEMO_KEY, 7))
    one.local_clear = True
    assert len(one.coast(9)[1]) == device.ROW
    assert not one.local_clear
    one.coast(9, dropped=3)
    assert one.state.counters[COUNT_TX_DROPPED] == 3
    one.break_motor(stuck=True)
    torque_nm = one.actuator.torque_nm
    assert len(one.coast(9, dropped=3)[1]) == device.ROW
    assert one.actuator.torque_nm == torque_nm


@built
def test_a_stretch_ends_with_the_tick_that_brings_something() -> None:
    one = device.Device(power_on("c", DEMO_KEY, 7), "still")
    while one.ticks < 500:
        sent, path = one.coast(64)
        made = len(path) // device.ROW
        assert sent or made == 64 or one.ticks <= 60  # while it boots
    assert one.ticks - 500 < 64


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
