"""What every bridge of a scenario is made of: the bundle and the DBC that ship, and the scenario's gate."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from hilbridge.config import GateSection
from hilbridge.intent.bundle import Bundle, demo_bundle_path, load_bundle
from hilbridge.runtime.assemble import Parts, gate_config
from hilbridge.wire.codec import Codec
from hilscenario.format.schema import Scenario


@cache
def bundle() -> Bundle:
    """The bundle that ships, read once."""
    return load_bundle(demo_bundle_path())


@cache
def codec() -> Codec:
    """The DBC that ships, read once."""
    return Codec()


def parts_of(scenario: Scenario) -> Parts:
    """The scenario's parts; thresholds are settled by the rule of live runs. Raises InputError."""
    asked = scenario.gate
    gate = gate_config(GateSection(tau_on=asked.tau_on, tau_off=asked.tau_off, alpha=asked.alpha), bundle())
    return Parts(bundle(), replace(gate, refractory_ns=asked.refractory), codec(), demo_bundle_path())
