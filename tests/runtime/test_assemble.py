"""runtime.assemble: what may act on a physical bus, and what is refused in one line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.attachment import VIRTUAL_INTERFACES as DEVICE_VIRTUAL
from firmware_sim.attachment import parse_spec as device_spec
from hilbridge.bus.port.spec import VIRTUAL_INTERFACES, BusSpec, parse_spec
from hilbridge.config import BusConfig, Config, GateSection, ModelConfig
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import Frame
from hilbridge.runtime import assemble
from hilbridge.runtime.assemble import Parts, arming_refusal, build_node, gate_config, read_parts
from hilbridge.runtime.node import BridgeNode
from hilbridge.wire.codec import Decoded
from hilbridge.wire.link import WireLink

AFFIRMED: dict[str, object] = {
    "origin": "recorded people",
    "trained_on": "twelve people",
    "people": 12,
    "certificate": {"precision": 0.8, "delta": 0.1, "method": "betting"},
}


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
    return replace(parts, bundle=replace(parts.bundle, provenance=AFFIRMED))


def node_for(parts: Parts, port: FakePort, config: BusConfig) -> BridgeNode:
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
    assert node.bridge._config.listen_only
    assert not node.bridge._config.arm


def test_a_virtual_bus_arms_by_itself(parts: Parts) -> None:
    node = node_for(parts, FakePort(False, False), BusConfig(spec="vcan0"))
    assert node.bridge._config.arm


def arming_nonces(node: BridgeNode, armings: int) -> list[int]:
    """Nonces of ARM_REQUEST over so many armings, each completed and then lost, by a device that agrees to all."""
    device, nonces, now_ns = WireLink(node.wire.codec, "CONTROLLER"), [], 0

    def says(message: str, **signals: int | float | str) -> list[Frame]:
        return node.receive(device.encode(message, signals), now_ns)[1]

    says("CTRL_HB", ProtocolVersion=1, BootNonce=9)
    says("CTRL_DIAG", Index="MacFailures", MacFailures=0)
    while len(nonces) < armings:
        now_ns += 40 * MS
        says("CTRL_STATUS", State="Follow", Armed=0)
        for frame in node.tick(None, (), now_ns).frames:
            message = device.decode(frame)
            if isinstance(message, Decoded) and message.name == "ARM_REQUEST":
                nonces.append(int(message.signals["BridgeNonce"]))
                says("ARM_CHALLENGE", DeviceNonce=len(nonces), Session=1 + len(nonces) % 255)
                says("CTRL_STATUS", State="Follow", Armed=1, Session=1 + len(nonces) % 255)
                assert node.bridge.session.armed
    return nonces


@pytest.mark.requirement("P6")
def test_h1_every_arming_has_a_fresh_nonce_of_full_length(parts: Parts) -> None:
    node = node_for(parts, FakePort(False, False), BusConfig(spec="vcan0"))
    nonces = arming_nonces(node, 120)
    assert len(set(nonces)) == 120
    for bit in range(32):  # each bit is now this, now that: 2 in 2^120 for a fair one
        assert {nonce >> bit & 1 for nonce in nonces} == {0, 1}


@pytest.mark.requirement("P6")
def test_h1_the_bridges_nonce_is_32_bits_of_the_system(parts: Parts, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = iter((0xFEDCBA98, 0x00000001))
    asked: list[int] = []
    monkeypatch.setattr(assemble.secrets, "randbits", lambda bits: (asked.append(bits), next(drawn))[1])
    node = node_for(parts, FakePort(False, False), BusConfig(spec="vcan0"))
    assert arming_nonces(node, 2) == [0xFEDCBA98, 0x00000001]
    assert asked == [32, 32]


def test_thresholds_of_the_configuration_win_but_must_make_a_band(parts: Parts) -> None:
    ours = gate_config(GateSection(tau_on=0.95), parts.bundle)
    assert (ours.tau_on, ours.tau_off) == (0.95, parts.bundle.thresholds.tau_off)
    assert gate_config(GateSection(), parts.bundle).tau_on == parts.bundle.thresholds.tau_on
    with pytest.raises(InputError, match="set both tau_on and tau_off"):
        gate_config(GateSection(tau_on=0.3), parts.bundle)


def test_a_missing_bundle_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.safetensors"):
        read_parts(Config(model=ModelConfig(bundle=str(tmp_path / "none.safetensors"))))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12),
    lambda inner: st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=4,
)


def test_h1_a_provenance_that_affirms_everything_may_arm() -> None:
    assert arming_refusal(AFFIRMED) is None


@given(st.dictionaries(st.sampled_from(sorted(AFFIRMED)) | st.text(max_size=8), JSON, max_size=5))
def test_h1_no_foreign_or_empty_provenance_may_arm(provenance: dict[str, object]) -> None:
    assert arming_refusal(provenance) is not None


@given(st.sampled_from(["origin", "people", "certificate"]), JSON)
def test_h1_each_statement_is_needed(name: str, other: object) -> None:
    assert arming_refusal({key: value for key, value in AFFIRMED.items() if key != name}) is not None
    if name != "people" or type(other) is not int:
        assert arming_refusal({**AFFIRMED, name: other}) is not None


@pytest.mark.parametrize(
    "certificate",
    [{}, {"method": "x"}, {"method": "", "precision": 0.8, "delta": 0.1}, {"method": "x", "precision": 0.8}],
)
def test_h1_half_a_certificate_is_none(certificate: dict[str, object]) -> None:
    assert arming_refusal({**AFFIRMED, "certificate": certificate}) is not None
    assert arming_refusal({**AFFIRMED, "people": 0}) is not None
    assert arming_refusal({**AFFIRMED, "people": True}) is not None
    assert arming_refusal({**AFFIRMED, "trained_on": "a Simulated wearer"}) is not None


@pytest.mark.parametrize("name", ["precision", "delta"])
@pytest.mark.parametrize("value", [0.0, 1.0, 1.5, -0.1, float("nan"), float("inf"), 1, True, "0.8", None])
def test_h1_a_certificate_promises_a_share_and_nothing_else(name: str, value: object) -> None:
    certificate = {"precision": 0.8, "delta": 0.1, "method": "betting", name: value}
    assert arming_refusal({**AFFIRMED, "certificate": certificate}) is not None


def test_h1_one_list_says_what_is_virtual() -> None:
    assert VIRTUAL_INTERFACES == DEVICE_VIRTUAL == {"hilsim", "virtual"}
    for text in ("slcan:/dev/ttyUSB0", "pcan:PCAN_USBBUS1"):
        assert not parse_spec(text).is_simulated
        assert device_spec(text).physical
