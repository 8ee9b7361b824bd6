"""hilscenario.world.parts: a scenario's gate is settled by the rule of live runs."""

from __future__ import annotations

import pytest

from hilbridge.config import GateSection
from hilbridge.errors import InputError
from hilbridge.runtime.assemble import gate_config
from hilscenario.world.parts import bundle, parts_of
from tests.scenarios.made import scenario


def test_thresholds_are_those_of_a_live_run_that_asks_for_the_same() -> None:
    for asked in ({}, {"tau_on": 0.95}, {"tau_on": 0.5, "tau_off": 0.4, "alpha": 0.6}):
        gate = parts_of(scenario(gate=asked)).gate
        assert gate == gate_config(GateSection(**asked), bundle())


def test_a_threshold_below_the_bundles_own_tau_off_is_refused_and_not_mended() -> None:
    with pytest.raises(InputError, match="set both tau_on and tau_off"):
        parts_of(scenario(gate={"tau_on": 0.7}))


def test_thresholds_that_make_no_band_are_refused_with_the_scenario() -> None:
    with pytest.raises(InputError, match=r"tau_off = 0\.7 must be below tau_on = 0\.7"):
        scenario(gate={"tau_on": 0.7, "tau_off": 0.7})


def test_the_refractory_time_is_the_scenarios_to_the_nanosecond() -> None:
    assert parts_of(scenario(gate={"refractory": "80.5 ms"})).gate.refractory_ns == 80_500_000
