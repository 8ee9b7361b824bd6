"""runtime.assemble: what may act on a physical bus, and what is refused in one line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from firmware_sim.attachment import VIRTUAL_INTERFACES as DEVICE_VIRTUAL
from firmware_sim.attachment import parse_spec as device_spec
from hilbridge.bus.port.spec import VIRTUAL_INTERFACES, BusSpec, parse_spec
from hilbridge.config import BusConfig, Config, GateSection, ModelConfig
from hilbridge.errors import InputError
from hilbridge.intent.bundle import Replayed
from hilbridge.intent.provenance import LEAST_PEOPLE, Origin, Promise, Provenance
from hilbridge.limits import MS
from hilbridge.records import Frame
from hilbridge.runtime import assemble
from hilbridge.runtime.assemble import Parts, build_node, gate_config, read_parts
from hilbridge.runtime.node import BridgeNode
from hilbridge.wire.codec import Decoded
from hilbridge.wire.link import WireLink

AFFIRMED = Provenance(
    Origin.RECORDED,
    LEAST_PEOPLE,
    60.0,
    {},
    tuple(f"person {number}" for number in range(LEAST_PEOPLE)),
    {"P-01.mcap": "a" * 64},
    certificate=Promise(0.3, 0.8, 0.1, "betting", "precision", 30, Origin.RECORDED),
)


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
    with pytest.raises(InputError, match=r"trained on simulated people, refused with --arm on a physical bus"):
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


@pytest.mark.parametrize("doubt", ["it has no provenance", "it was edited after it was sealed"])
def test_h1_a_record_in_doubt_may_not_arm_a_physical_bus(of_people: Parts, doubt: str) -> None:
    doubted = replace(of_people, bundle=replace(of_people.bundle, doubt=doubt))
    with pytest.raises(InputError, match=doubt):
        node_for(doubted, FakePort(True, False), BusConfig(spec="can0", arm=True, uncertified=True))
    node_for(doubted, FakePort(False, False), BusConfig(spec="vcan0"))


def test_h1_a_threshold_below_the_certified_one_may_not_arm_a_physical_bus(of_people: Parts) -> None:
    lower = replace(of_people, gate=replace(of_people.gate, tau_on=0.29, tau_off=0.2))
    with pytest.raises(InputError, match=r"below 0\.3, which is certified"):
        node_for(lower, FakePort(True, False), BusConfig(spec="can0", arm=True))


@pytest.mark.parametrize(
    "changed",
    [{"alpha": 0.5}, {"top_k": 21}, {"refractory_ns": 0}, {"tau_off": 0.05}],
    ids=lambda changed: next(iter(changed)),
)
def test_h1_another_gate_than_was_certified_may_not_arm_a_physical_bus(
    of_people: Parts, changed: dict[str, float], tmp_path: Path
) -> None:
    key = tmp_path / "own.key"
    key.write_text("0f" * 16)
    key.chmod(0o600)
    config = BusConfig(spec="can0", arm=True, key_file=str(key))
    node_for(of_people, FakePort(True, False), config)
    other = replace(of_people, gate=replace(of_people.gate, **changed))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="certified with, refused with --arm"):
        node_for(other, FakePort(True, False), config)
    node_for(other, FakePort(False, False), BusConfig(spec="vcan0"))


def test_a_bench_arms_with_simulated_people_and_an_own_key_alone(
    parts: Parts, of_people: Parts, tmp_path: Path
) -> None:
    key = tmp_path / "own.key"
    key.write_text("0f" * 16)
    key.chmod(0o600)
    config, port = BusConfig(spec="can0", arm=True, key_file=str(key)), FakePort(True, False)

    def bench(of: Parts, config: BusConfig = config) -> BridgeNode:
        return build_node(of, port, config, lambda now_ns, text: None, on_a_bench=True)  # type: ignore[arg-type]

    assert bench(parts).bridge._config.arm
    unknown = replace(parts, bundle=replace(parts.bundle, provenance=None))
    doubted = replace(parts, bundle=replace(parts.bundle, doubt="its seal is broken"))
    for of, said in ((of_people, "recorded people"), (unknown, "unknown origin"), (doubted, "its seal is broken")):
        with pytest.raises(
            InputError, match=f"the bundle is of {said}, and only one of simulated people is for a bench"
        ):
            bench(of)
    with pytest.raises(InputError, match="demo key is public"):
        bench(parts, BusConfig(spec="can0", arm=True))


def test_an_uncertified_bench_says_so(of_people: Parts, tmp_path: Path) -> None:
    record = replace(AFFIRMED, certificate=None)
    bare = replace(of_people, bundle=replace(of_people.bundle, provenance=record))
    key = tmp_path / "own.key"
    key.write_text("0f" * 16)
    key.chmod(0o600)
    with pytest.raises(InputError, match="not certified"):
        node_for(bare, FakePort(True, False), BusConfig(spec="can0", arm=True, key_file=str(key)))
    said: list[str] = []
    config = BusConfig(spec="can0", arm=True, key_file=str(key), uncertified=True)
    build_node(bare, FakePort(True, False), config, lambda now_ns, text: said.append(text))  # type: ignore[arg-type]
    assert any("UNCERTIFIED" in text for text in said)


def test_a_precision_chooses_the_threshold_or_says_what_is_reached(parts: Parts) -> None:
    curve = tuple(Replayed(tau, tau, 0.1, 9, tau, 0.1) for tau in (0.5, 0.7, 0.9))
    bundle = replace(parts.bundle, curve=curve)
    chosen = gate_config(GateSection(precision=0.65), bundle)
    band = bundle.thresholds.tau_on - bundle.thresholds.tau_off
    assert (chosen.tau_on, chosen.tau_off) == (0.7, pytest.approx(0.7 - band))
    assert chosen.maps == bundle.maps
    with pytest.raises(InputError, match=r"gate\.precision = 0\.95: .*reaches 0\.900 at most"):
        gate_config(GateSection(precision=0.95), bundle)
    assert gate_config(GateSection(precision=0.65, tau_on=0.8), bundle).tau_on == 0.8


def test_h1_one_list_says_what_is_virtual() -> None:
    assert VIRTUAL_INTERFACES == DEVICE_VIRTUAL == {"hilsim", "virtual"}
    for text in ("slcan:/dev/ttyUSB0", "pcan:PCAN_USBBUS1"):
        assert not parse_spec(text).is_simulated
        assert device_spec(text).physical
