"""runtime.assemble: what may act on a physical bus, and what is refused in one line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from hilbridge.bus.port.spec import BusSpec
from hilbridge.config import BusConfig, Config, GateSection, ModelConfig
from hilbridge.errors import InputError
from hilbridge.runtime.assemble import Parts, build_node, gate_config, read_parts


@dataclass
class FakePort:
    """A connected port as far as assembling looks at one; the adapter behind it is hardware nobody has here."""

    is_physical: bool
    listen_only: bool
    spec = BusSpec("socketcan", "can0")


@pytest.fixture(scope="module")
def parts() -> Parts:
    return read_parts(Config())


@pytest.fixture
def of_people(parts: Parts) -> Parts:
    return replace(parts, bundle=replace(parts.bundle, provenance={"trained_on": "twelve people"}))


def node_for(parts: Parts, port: FakePort, config: BusConfig) -> object:
    return build_node(parts, port, config, lambda now_ns, text: None)  # type: ignore[arg-type]


def test_a_bundle_of_simulated_wearers_may_not_act_on_a_physical_bus(parts: Parts, tmp_path: Path) -> None:
    config = BusConfig(spec="can0", arm=True, key_file=str(tmp_path / "none.key"))
    with pytest.raises(InputError, match=r"trained on simulated wearer.*refused with --arm on a physical bus"):
        node_for(parts, FakePort(True, False), config)


def test_the_demo_key_may_not_act_on_a_physical_bus(of_people: Parts) -> None:
    with pytest.raises(InputError, match="demo key is public and refused on a physical bus"):
        node_for(of_people, FakePort(True, False), BusConfig(spec="can0", arm=True))


def test_a_physical_bus_is_listened_to_without_a_key_of_ones_own(parts: Parts) -> None:
    node = node_for(parts, FakePort(True, True), BusConfig(spec="can0"))
    assert node.bridge._config.listen_only  # type: ignore[attr-defined]
    assert not node.bridge._config.arm  # type: ignore[attr-defined]


def test_a_virtual_bus_arms_by_itself(parts: Parts) -> None:
    node = node_for(parts, FakePort(False, False), BusConfig(spec="vcan0"))
    assert node.bridge._config.arm  # type: ignore[attr-defined]


def test_thresholds_of_the_configuration_win_but_must_make_a_band(parts: Parts) -> None:
    ours = gate_config(GateSection(tau_on=0.95), parts.bundle)
    assert (ours.tau_on, ours.tau_off) == (0.95, parts.bundle.thresholds.tau_off)
    assert gate_config(GateSection(), parts.bundle).tau_on == parts.bundle.thresholds.tau_on
    with pytest.raises(InputError, match="set both tau_on and tau_off"):
        gate_config(GateSection(tau_on=0.3), parts.bundle)


def test_a_missing_bundle_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.safetensors"):
        read_parts(Config(model=ModelConfig(bundle=str(tmp_path / "none.safetensors"))))
