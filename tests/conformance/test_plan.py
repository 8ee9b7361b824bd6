"""The whole plan against both controllers in virtual time; and against planted defects, each found by its own line."""

from __future__ import annotations

import pytest

from firmware_sim.c import binding
from firmware_sim.frames import ARM_CHALLENGE
from firmware_sim.plant.arm import Arm
from hilbridge.conformance.findings import Verdict
from hilbridge.conformance.plan import CASES, chosen, conduct
from hilbridge.errors import InputError
from tests.conformance.lockstep import LockstepLine, a_tester
from tests.conformance.planted import DEFECTS, Defect, planted


class Clamped(Arm):
    """An arm in a vice."""

    def step(self, device_nm: float, wearer_nm: float, dt_s: float) -> None:
        del device_nm, wearer_nm, dt_s


@pytest.mark.parametrize("controller", ["python", "c"])
def test_both_controllers_keep_every_claim(controller: str) -> None:
    if controller == "c" and not binding.available():
        pytest.skip(f"the C controller is {binding.why_not()}")
    findings = conduct(a_tester(LockstepLine(controller), phases=25), CASES)
    assert [finding for finding in findings if finding.verdict is not Verdict.KEPT] == []


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect.name)
def test_a_planted_defect_is_found_by_its_own_line(defect: Defect) -> None:
    with planted(defect):
        findings = conduct(a_tester(LockstepLine()), CASES)
    assert {finding.name for finding in findings if finding.verdict is Verdict.BROKEN} == defect.lines


@pytest.mark.parametrize("seed", range(3))
def test_chance_changes_no_verdict(seed: int) -> None:
    line = LockstepLine("c" if binding.available() else "python", seed=seed + 20)
    assert {finding.verdict for finding in conduct(a_tester(line), CASES)} == {Verdict.KEPT}


def test_without_a_hand_what_needs_one_is_not_shown_and_nothing_is_broken() -> None:
    findings = conduct(a_tester(LockstepLine(), hand=False), CASES)
    assert Verdict.BROKEN not in {finding.verdict for finding in findings}
    assert "--clear-command" in next(one.seen for one in findings if one.name == "three-macs")


def test_with_another_key_it_says_so() -> None:
    findings = conduct(a_tester(LockstepLine(), wrong_key=True), chosen(["acts"]))
    assert findings[0].verdict is Verdict.UNSHOWN
    assert "key" in findings[0].seen


def test_an_arm_that_does_not_move_shows_no_torque() -> None:
    line = LockstepLine()
    line.device.arm = Clamped()
    findings = conduct(a_tester(line), chosen(["hold-to-zero"]))
    assert findings[0].verdict is Verdict.UNSHOWN
    assert "move the joint" in findings[0].seen


def test_a_device_that_answers_too_late_is_told_so_with_the_cure() -> None:
    line = LockstepLine()
    line.late_ms[ARM_CHALLENGE] = 420
    (finding,) = conduct(a_tester(line), chosen(["arming"]))
    assert finding.verdict is Verdict.BROKEN
    assert "after 42" in finding.seen
    assert "answer in the tick" in finding.seen


def test_a_device_that_answers_twice_is_told_so_with_the_cure() -> None:
    line = LockstepLine()
    line.twice.add(ARM_CHALLENGE)
    (finding,) = conduct(a_tester(line), chosen(["arming"]))
    assert finding.seen.startswith("2 challenges to one request; take a second device off")


def test_a_claim_that_does_not_exist_is_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean `stop-to-zero`"):
        chosen(["stop-to-zerro"])


def test_names_are_single() -> None:
    assert len({case.name for case in CASES}) == len(CASES)
