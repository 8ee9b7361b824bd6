"""The simulated bus within one process: virtual time, python-can's own behaviour, errors and states as messages."""

from __future__ import annotations

import can
import pytest

from hilbridge.bus.model.bits import frame_length
from hilbridge.bus.model.error_frames import CLASS_BUS_OFF, CLASS_NO_ACK, ErrorState, read_error_frame
from hilbridge.bus.model.faults import Corruption, WireFaults
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.interface import SimulatedBus
from hilbridge.bus.simulated.network import Network, VirtualClock


def message(can_id: int, data: bytes = b"", **more: bool) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False, **more)


def test_it_is_a_python_can_interface_and_stamps_bus_time() -> None:
    network = Network()
    one = can.Bus(interface="hilsim", channel=network)  # type: ignore[arg-type]
    with one, SimulatedBus(network) as other:
        one.send(message(0x060, b"12345678"))
        got = other.recv(1.0)
        assert got is not None
        bits = frame_length(WireFrame(0x060, b"12345678")).nominal_bits
        assert got.timestamp == bits * 2e-6
        assert network.clock.now_ns() == bits * 2_000


def test_messages_of_one_time_compete_and_time_passes_only_for_those_who_wait() -> None:
    network = Network()
    with SimulatedBus(network) as one, SimulatedBus(network) as two, SimulatedBus(network) as listener:
        one.send(message(0x700))
        two.send(message(0x100))
        one.send(message(0x200))
        assert listener.recv(0) is None
        assert network.clock.now_ns() == 0
        assert [m.arbitration_id for m in (listener.recv(1.0) for _ in range(3)) if m] == [0x100, 0x700, 0x200]
        before = network.clock.now_ns()
        assert listener.recv(0.25) is None
        assert network.clock.now_ns() == before + 250_000_000


def test_waiting_for_ever_where_nobody_sends_is_an_error_not_a_hang() -> None:
    with SimulatedBus(Network()) as bus, pytest.raises(can.CanOperationError, match="nobody sends"):
        bus.recv(None)


def test_a_full_queue_refuses_at_once_or_after_the_time_given() -> None:
    network = Network()
    with SimulatedBus(network) as one, SimulatedBus(network) as other:
        for value in range(10):
            one.send(message(value))
        with pytest.raises(can.CanOperationError, match="transmit queue full") as caught:
            one.send(message(10))
        assert caught.value.error_code == 105
        one.send(message(11), timeout=0.01)  # room after one frame
        assert len([m for m in (other.recv(0.1) for _ in range(11)) if m]) == 11


def test_a_message_no_controller_can_send_is_refused() -> None:
    with SimulatedBus(Network()) as bus, pytest.raises(can.CanOperationError, match="no data-length code"):
        bus.send(can.Message(arbitration_id=1, data=bytes(9), is_fd=True, check=False))


def test_fd_and_remote_frames_pass_whole() -> None:
    network = Network()
    with SimulatedBus(network, fd=True) as one, SimulatedBus(network, fd=True) as other:
        one.send(message(0x123, bytes(range(48)), is_fd=True, bitrate_switch=True))
        one.send(can.Message(arbitration_id=0x124, is_extended_id=False, is_remote_frame=True, dlc=5))
        fd, remote = other.recv(1.0), other.recv(1.0)
        assert fd is not None
        assert remote is not None
        assert (fd.is_fd, fd.bitrate_switch, bytes(fd.data)) == (True, True, bytes(range(48)))
        assert (remote.is_remote_frame, remote.dlc) == (True, 5)


def test_a_lone_sender_learns_of_missing_acknowledgements_by_error_frames() -> None:
    network = Network()
    with SimulatedBus(network, bus_errors=True) as lone:
        lone.send(message(0x123))
        frames = [m for m in (lone.recv(0.01) for _ in range(40)) if m]
        assert all(m.is_error_frame for m in frames)
        assert all(m.arbitration_id & CLASS_NO_ACK for m in frames if not m.data[1])
        states = [read_error_frame(m.arbitration_id, bytes(m.data)).controller for m in frames]
        assert [state for state in states if state] == [ErrorState.WARNING, ErrorState.PASSIVE]
        assert lone.state is can.BusState.PASSIVE
        with SimulatedBus(network) as helper:
            got = helper.recv(0.1)
            assert got is not None
            assert got.arbitration_id == 0x123


def test_bus_off_is_told_refuses_frames_and_ends_where_asked() -> None:
    faults = WireFaults(corruptions=(Corruption(0x100, count=32),))
    network = Network(Medium(faults=faults))
    with SimulatedBus(network) as one, SimulatedBus(network) as other:
        network.medium.node(1).auto_recover = False
        one.send(message(0x100, b"\x12\x34"))
        told = [m for m in (one.recv(0.1) for _ in range(4)) if m]
        assert told[-1].arbitration_id & CLASS_BUS_OFF
        assert one.state is can.BusState.ERROR
        with pytest.raises(can.CanOperationError, match="bus off"):
            one.send(message(0x100))
        one.state = can.BusState.ACTIVE
        assert one.recv(0.002) is None  # 128 times eleven bits at 500 kbit/s take 2.8 ms
        back = one.recv(0.002)
        assert back is not None
        assert read_error_frame(back.arbitration_id, bytes(back.data)).controller is ErrorState.ACTIVE
        one.send(message(0x101))
        got = other.recv(1.0)
        assert got is not None
        assert got.arbitration_id == 0x101
        with pytest.raises(NotImplementedError):
            one.state = can.BusState.PASSIVE


def test_a_slow_reader_loses_the_newest_and_learns_how_many() -> None:
    clock = VirtualClock()
    network = Network(Medium(1_000_000), clock)
    sender, reader = network.attach("sender"), network.attach("reader")
    for _ in range(9000):
        sender.send(WireFrame(0x100), timeout_s=1.0)
    clock.wait_until(clock.now_ns() + 10**9)
    network.pump()
    arrivals = []
    while (arrival := reader.receive()) is not None:
        arrivals.append(arrival)
    assert len(arrivals) == 8192
    assert reader.dropped == 9000 - 8192
    sender.send(WireFrame(0x101))
    later = reader.receive_within(1.0)
    assert later is not None
    assert later.dropped == 808


def test_a_station_knows_the_state_of_its_chip_through_bus_off_and_back() -> None:
    clock = VirtualClock()
    medium = Medium(faults=WireFaults(corruptions=(Corruption(0x100, count=32),)))
    network = Network(medium, clock)
    sender, reader = network.attach("sender"), network.attach("reader")
    sender.send(WireFrame(0x100, bytes(8)))
    seen = [sender.state]
    for _ in range(2000):
        clock.wait_until(clock.now_ns() + 10_000)
        network.pump()
        for station in (sender, reader):
            assert station.state is medium.node(station.number).state
        if sender.state is not seen[-1]:
            seen.append(sender.state)
    active, warning, passive, off = (
        ErrorState.ACTIVE,
        ErrorState.WARNING,
        ErrorState.PASSIVE,
        ErrorState.BUS_OFF,
    )
    assert seen == [active, warning, passive, off, active]


class SteppedClock:
    """A clock of another kind than VirtualClock: it overshoots every wait, as real ones do."""

    def __init__(self) -> None:
        self.now = 0

    def now_ns(self) -> int:
        return self.now

    def wait_until(self, when_ns: int) -> None:
        self.now = max(self.now, when_ns) + 1_000


def test_any_clock_will_do() -> None:
    network = Network(clock=SteppedClock())
    with SimulatedBus(network) as one, SimulatedBus(network) as other:
        for value in range(5):
            one.send(message(0x100 + value))
        assert [m.arbitration_id for m in (other.recv(1.0) for _ in range(5)) if m] == list(range(0x100, 0x105))
        assert other.recv(0.01) is None


def test_a_node_that_left_is_no_longer_heard() -> None:
    network = Network()
    with SimulatedBus(network) as stays, SimulatedBus(network) as also:
        leaver = SimulatedBus(network)
        leaver.send(message(0x100))
        leaver.shutdown()
        stays.send(message(0x200))
        got = also.recv(1.0)
        assert got is not None
        assert got.arbitration_id == 0x200
