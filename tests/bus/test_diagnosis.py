"""The rules of `doctor --bus`: each ailment from the signs a Linux driver gives, and a healthy bus without complaint."""

from __future__ import annotations

import uuid
from dataclasses import replace
from pathlib import Path

import can
import pytest

from hilbridge.bus.diagnosis import BusFinding, Observation, Severity, diagnose, known_messages, observe
from hilbridge.bus.model.error_frames import ErrorKind, ErrorState, write_error_frame
from hilbridge.bus.port.netlink import LinkInfo
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import Frame

DBC = Path(__file__).parents[2] / "dbc" / "iassistadl.dbc"
CAN0 = LinkInfo("can0", "can", True, 10, 500_000, None, "error-active", 0, 0, restart_ms=100)
KNOWN = known_messages(DBC)


def status(count: int, *, cycle_ms: float = 20.0, start: int = 0) -> list[Frame]:
    """CTRL_STATUS as a healthy device sends it."""
    return [
        Frame(0x0A0, bytes([0, 0, (start + number) % 256, 2, 0, 0, 0, 0]), received_ns=int(number * cycle_ms * MS))
        for number in range(count)
    ]


def error(kind: ErrorKind | None = None, state: ErrorState | None = None, tec: int = 0, rec: int = 0) -> Frame:
    classes, data = write_error_frame(state, tec, rec, kind=kind)
    return Frame(classes, data, is_error=True)


def findings(frames: list[Frame], link: LinkInfo | None = CAN0, **more: object) -> dict[str, BusFinding]:
    seen = Observation("can0", 3.0, tuple(frames), link, "can0")
    return {finding.subject: finding for finding in diagnose(replace(seen, **more), KNOWN)}  # type: ignore[arg-type]


def test_a_healthy_bus_is_well() -> None:
    found = findings(status(150))
    assert {finding.severity for finding in found.values()} == {Severity.WELL}
    assert "500000" in found["bus link"].text
    assert all(not finding.cure for finding in found.values())


def test_a_link_that_is_down_names_the_command() -> None:
    found = findings([], link_up=False)
    assert found["bus link"].severity is Severity.ILL
    assert found["bus link"].cure == "sudo ip link set can0 up type can bitrate 500000 restart-ms 100"
    assert len(found) == 1


def test_an_interface_set_to_another_bit_rate_than_the_dbc() -> None:
    found = findings([], replace(CAN0, bitrate=250_000))
    assert found["bit rate"].severity is Severity.ILL
    assert "250000" in found["bit rate"].text
    assert "bitrate 500000" in found["bit rate"].cure


@pytest.mark.parametrize(
    ("frames", "link"),
    [
        ([error(ErrorKind.STUFF)] * 40, CAN0),
        ([error(ErrorKind.FORM)] * 5, replace(CAN0, state="error-passive", rx_errors=135)),
        ([error(state=ErrorState.PASSIVE, rec=135)], None),
        ([], replace(CAN0, state="error-warning", rx_errors=110)),
    ],
)
def test_errors_without_a_single_good_frame_mean_another_bit_rate(frames: list[Frame], link: LinkInfo | None) -> None:
    found = findings(frames, link)
    assert found["bit rate"].severity is Severity.ILL
    assert "another bit rate" in found["bit rate"].text


def test_errors_among_good_frames_mean_termination() -> None:
    found = findings([*status(150), *[error(ErrorKind.BIT)] * 30])
    assert found["termination"].severity is Severity.ILL
    assert "60 ohm" in found["termination"].cure
    few = findings([*status(150), *[error(ErrorKind.BIT)] * 3])
    assert few["termination"].severity is Severity.NOTE
    assert "termination" not in findings([*status(150), error(ErrorKind.BIT)])


def test_bus_off_now_or_lately() -> None:
    now = findings([], replace(CAN0, state="bus-off", tx_errors=248, rx_errors=0))
    assert now["controller"].severity is Severity.ILL
    assert "is bus-off (TEC 248" in now["controller"].text
    assert "restart" in now["controller"].cure
    lately = findings([*status(50), error(state=ErrorState.BUS_OFF)])
    assert "was bus-off" in lately["controller"].text


def test_nobody_acknowledges() -> None:
    found = findings([error(ErrorKind.ACK)] * 20)
    assert found["traffic"].severity is Severity.ILL
    assert "nobody acknowledges" in found["traffic"].text


def test_silence_is_a_note() -> None:
    assert findings([])["traffic"].severity is Severity.NOTE


def test_another_bridge_on_the_bus() -> None:
    found = findings([*status(100), Frame(0x060, bytes(8)), Frame(0x120, bytes(8))])
    assert found["identifiers"].severity is Severity.ILL
    assert "ACT_CMD, BRIDGE_HB" in found["identifiers"].text
    assert "identifiers" not in findings([*status(100), Frame(0x001, b"")])  # STOP anybody may send


def test_two_devices_with_the_same_identifiers() -> None:
    one, other = status(100), status(100, start=128)
    both = [frame for pair in zip(one, other, strict=True) for frame in pair]
    found = findings(both)
    assert found["identifiers"].severity is Severity.ILL
    assert "CTRL_STATUS" in found["identifiers"].text
    # A device that sends at once on changes of state comes more often too, but counts on in one sequence.
    assert "identifiers" not in findings(status(100, cycle_ms=10.0))


def test_strangers_are_noted() -> None:
    found = findings([*status(100), *[Frame(0x700 + number, b"") for number in range(8)]])
    assert found["identifiers"].severity is Severity.NOTE
    assert "0x700" in found["identifiers"].text


def test_modes_worth_knowing() -> None:
    found = findings(status(100), replace(CAN0, listen_only=True, restart_ms=0))
    assert found["bus mode"].severity is Severity.NOTE
    assert found["bus-off recovery"].severity is Severity.NOTE
    virtual = findings(status(100), LinkInfo("vcan0", "vcan", True))
    assert "virtual" in virtual["bus link"].text
    passive = findings(status(100), replace(CAN0, state="error-passive", tx_errors=130, rx_errors=2))
    assert "TEC 130" in passive["controller"].text
    lost = findings(status(100), lost=7)
    assert "7 frames" in lost["receive buffer"].text
    assert findings(status(100), replace(CAN0, bitrate=None))["bus link"].severity is Severity.WELL
    assert findings(status(100), None)["bus link"].severity is Severity.WELL


async def test_observing_hears_what_is_sent_and_sends_nothing() -> None:
    name = f"test-{uuid.uuid4()}"
    with can.Bus(interface="hilsim", channel=name) as device, can.Bus(interface="hilsim", channel=name) as witness:
        for number in range(5):
            device.send(can.Message(arbitration_id=0x0A0, data=[0, 0, number, 2, 0, 0, 0, 0], is_extended_id=False))
        task = observe(f"hilsim:{name}", 0.3)
        device.send_periodic(can.Message(arbitration_id=0x0A0, data=bytes(8), is_extended_id=False), 0.01)
        seen = await task
        device.stop_all_periodic_tasks()
        assert {frame.can_id for frame in seen.good} == {0x0A0}
        ids = set()
        while (message := witness.recv(0.05)) is not None:
            ids.add(message.arbitration_id)
        assert ids == {0x0A0}


def test_a_file_that_is_no_dbc(tmp_path: Path) -> None:
    (tmp_path / "x.dbc").write_text("no")
    with pytest.raises(InputError, match=r"x\.dbc"):
        known_messages(tmp_path / "x.dbc")
