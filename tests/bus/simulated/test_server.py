"""The owner of a simulated bus, in a thread: strangers at the door, readers who do not read, leaving when nobody stays."""

from __future__ import annotations

import socket
import threading
import uuid
from collections.abc import Iterator

import pytest

from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.client import BusClient, BusNotReachable
from hilbridge.bus.simulated.handshake import (
    CLIENT_LIMIT,
    HANDSHAKE_LIMIT_NS,
    SLOW_LIMIT_NS,
    STRANGER_LIMIT,
    Reception,
)
from hilbridge.bus.simulated.protocol import (
    HOST,
    LINK_VERSION,
    RECORD_BYTES,
    BusNameTaken,
    Flag,
    Kind,
    Record,
    claim,
    in_parts,
    open_stream,
    ports_of,
    read_within,
    unpack,
)
from hilbridge.bus.simulated.server import BusServer, serve

WAIT_S = 20.0


class Served:
    def __init__(self, *, bitrate: int = 500_000, linger_s: float | None = None) -> None:
        self.name = f"test-{uuid.uuid4()}"
        listener = claim(self.name)
        self.address: tuple[str, int] = listener.getsockname()
        self.server = BusServer(self.name, listener, Medium(bitrate, bitrate), linger_s=linger_s)
        self.thread = threading.Thread(target=self.server.run, daemon=True)  # a test that fails must end
        self.thread.start()


@pytest.fixture
def served() -> Iterator[Served]:
    running = Served()
    yield running
    running.server.stop()
    running.thread.join(WAIT_S)
    assert not running.thread.is_alive()


def client_of(served: Served, **options: bool | str) -> BusClient:
    return BusClient(served.name, start=False, **options)  # type: ignore[arg-type]


def receive(client: BusClient) -> WireFrame:
    assert client.wait_readable(WAIT_S)
    arrival = client.receive()
    assert arrival is not None
    return arrival.frame


def hello(name: str, **fields: int) -> bytes:
    return Record(Kind.HELLO, **{"extra": LINK_VERSION, **fields}, data=name.encode()).pack()


def test_strangers_are_turned_away_and_disturb_nobody(served: Served) -> None:
    one, other = client_of(served), client_of(served)
    for knock in (
        b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n" * 4,
        bytes(RECORD_BYTES),
        hello("another bus"),
        hello(served.name, extra=99),
        hello(served.name, flags=Flag.TRANSMIT_SIDE, sequence=1, stamp_ns=12345),  # another one's node, wrong cookie
        hello(served.name, flags=Flag.TRANSMIT_SIDE, sequence=77),
    ):
        with open_stream(served.address, WAIT_S) as stranger:
            stranger.sendall(knock[:RECORD_BYTES])
            answer = read_within(stranger, WAIT_S)
            assert (answer.kind, answer.data.decode()) == (Kind.REFUSED, served.name)
            assert stranger.recv(1) == b""
    with open_stream(served.address, WAIT_S) as hesitant:
        hesitant.sendall(b"half a record")
    assert one.send(WireFrame(0x123, b"ok")) is Enqueued.QUEUED
    assert receive(other).data == b"ok"
    one.close()
    other.close()


def test_the_other_half_of_a_client_is_only_its_own(served: Served) -> None:
    one = client_of(served)
    with open_stream(served.address, WAIT_S) as half:
        half.sendall(hello(served.name))
        welcome = read_within(half, WAIT_S)
        for cookie in (0, welcome.stamp_ns ^ 1, welcome.stamp_ns):
            with open_stream(served.address, WAIT_S) as other:
                other.sendall(hello("x", flags=Flag.TRANSMIT_SIDE, sequence=welcome.sequence, stamp_ns=cookie))
                kind = read_within(other, WAIT_S).kind
            assert kind == (Kind.WELCOME if cookie == welcome.stamp_ns else Kind.REFUSED)
    one.close()


def test_records_that_mean_nothing_are_passed_over(served: Served) -> None:
    one, other = client_of(served), client_of(served)
    for record in (
        Record(200, 255, 255, 0xFFFF_FFFF, -1, 5, 6, b"x" * 64),
        Record(Kind.WELCOME),
        Record(Kind.FRAME, 0, 0, 0xFFFF_FFFF, 0, 1),  # no such identifier
        Record(Kind.FRAME, Flag.REMOTE, 200, 0x100, 0, 2),  # no such length
        Record(Kind.CONTROL, data=b"\xff\xfe"),
    ):
        one._send_whole(record.pack())
    assert one.send(WireFrame(0x123)) is Enqueued.QUEUED
    assert receive(other) == WireFrame(0x123)
    one.close()
    other.close()


def test_a_reader_that_does_not_read_loses_frames_and_is_told_how_many() -> None:
    served = Served(bitrate=1_000_000_000)
    sender, idle = client_of(served), socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    idle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    idle.connect(served.address)
    idle.sendall(hello(served.name))
    assert read_within(idle, WAIT_S).kind == Kind.WELCOME
    total = 6000
    for number in range(total):
        assert sender.send(WireFrame(0x100, number.to_bytes(4, "little")), WAIT_S) is Enqueued.QUEUED
    assert sender.control({"op": "status"})["nodes"][0]["sent"] == total
    numbers, dropped = [], 0
    idle.settimeout(0.2)
    raw = b""
    try:
        while True:
            raw += idle.recv(65536)
            while len(raw) >= RECORD_BYTES:
                record, raw = unpack(raw[:RECORD_BYTES]), raw[RECORD_BYTES:]
                numbers.append(int.from_bytes(record.data, "little"))
    except TimeoutError:
        pass
    assert numbers == sorted(set(numbers))
    assert len(numbers) < total
    sender.send(WireFrame(0x101))
    dropped = read_within(idle, WAIT_S).dropped
    assert len(numbers) + dropped == total
    idle.close()
    sender.close()
    served.server.stop()
    served.thread.join(WAIT_S)


def test_listen_only_and_bad_frames_are_refused_before_they_travel(served: Served) -> None:
    mute, other = client_of(served, listen_only=True), client_of(served)
    assert mute.send(WireFrame(0x100)) is Enqueued.LISTEN_ONLY
    assert other.send(WireFrame(0x800)) is Enqueued.BAD_FRAME
    assert other.in_flight == 0
    mute.close()
    other.close()


def test_the_bus_ends_by_itself_when_nobody_has_stayed() -> None:
    served = Served(linger_s=0.0)
    first = client_of(served)
    second = client_of(served)
    first.close()
    assert second.control({"op": "status"})["bitrate"] == 500_000
    second.close()
    served.thread.join(WAIT_S)
    assert not served.thread.is_alive()


def test_clients_notice_the_end_of_the_bus(served: Served) -> None:
    client = client_of(served)
    served.server.stop()
    served.thread.join(WAIT_S)
    assert client.wait_readable(WAIT_S)
    with pytest.raises(OSError, match="gone"):
        client.receive()
    client.close()


def test_serve_says_when_it_is_ready_and_refuses_a_second_of_its_name() -> None:
    name = f"test-{uuid.uuid4()}"
    ready = threading.Event()
    thread = threading.Thread(target=serve, args=(name,), kwargs={"linger_s": 0.0, "ready": ready.set})
    thread.start()
    assert ready.wait(WAIT_S)
    with pytest.raises(BusNameTaken, match=name):
        serve(name)
    BusClient(name, start=False).close()
    thread.join(WAIT_S)
    assert not thread.is_alive()


def test_another_program_on_the_first_port_is_stepped_over() -> None:
    name = f"test-{uuid.uuid4()}"
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as squatter:
        squatter.bind((HOST, ports_of(name)[0]))
        squatter.listen()
        with claim(name) as listener:
            assert listener.getsockname()[1] == ports_of(name)[1]


def test_a_babble_of_an_impossible_identifier_and_deep_json_are_answered_not_obeyed(served: Served) -> None:
    one, other = client_of(served), client_of(served)
    for request in (
        {"op": "faults", "faults": {"babbles": [{"node": "pid 1", "can_id": 1 << 40}]}},
        {"op": "faults", "faults": {"bit_error_rate": 1e308}},
        {"op": "nothing"},
    ):
        assert "error" in one.control(request)
    one._send_whole(in_parts(Kind.CONTROL, b"[" * 100_000))  # longer than any request, and deeper
    status = other.control({"op": "status"})
    assert status["refused"]["requests"] >= 3
    assert one.send(WireFrame(0x123)) is Enqueued.QUEUED
    assert receive(other) == WireFrame(0x123)
    one.close()
    other.close()


def test_impossible_frames_are_refused_with_a_reason_and_counted(served: Served) -> None:
    one = client_of(served)
    one._send_whole(Record(Kind.FRAME, 0, 0, 0xFFFF_FFFF, 0, 41).pack())
    one.in_flight += 1
    refused = one.control({"op": "status"})["refused"]
    assert refused == {Enqueued.BAD_FRAME: 1}
    assert (one.in_flight, one.refused) == (0, 1)
    one.close()


def test_a_crowd_that_says_nothing_keeps_nobody_out(served: Served) -> None:
    crowd = [open_stream(served.address, WAIT_S) for _ in range(3 * STRANGER_LIMIT)]
    one, other = client_of(served), client_of(served)
    assert one.send(WireFrame(0x123)) is Enqueued.QUEUED
    assert receive(other) == WireFrame(0x123)
    assert one.control({"op": "status"})["refused"]["handshakes too many"] >= STRANGER_LIMIT
    for stream in crowd:
        stream.close()
    one.close()
    other.close()


def test_half_a_client_makes_room_for_a_whole_one_and_a_full_bus_says_so(served: Served) -> None:
    halves = [open_stream(served.address, WAIT_S) for _ in range(CLIENT_LIMIT)]
    for stream in halves:
        stream.sendall(hello(served.name))
        assert read_within(stream, WAIT_S).kind == Kind.WELCOME
    clients = [client_of(served) for _ in range(CLIENT_LIMIT)]
    with pytest.raises(BusNotReachable, match="close some"):
        client_of(served)
    assert len(clients[-1].control({"op": "status"})["nodes"]) == CLIENT_LIMIT
    for leaving in (*halves, *clients):
        leaving.close()


class Hand:
    """A clock that a test moves."""

    now_ns = 1_000_000_000

    def __call__(self) -> int:
        return self.now_ns


def test_slow_handshakes_and_unread_answers_end_in_time() -> None:
    name, clock = f"test-{uuid.uuid4()}", Hand()
    reception = Reception(name, claim(name), Medium(), clock)
    address = reception.listener.getsockname()
    silent, half = open_stream(address, WAIT_S), open_stream(address, WAIT_S)
    half.sendall(hello(name))
    while not reception.by_node:
        for stream, _, _ in reception.watch.wait(WAIT_S):
            if stream is reception.listener:
                reception.accept()
            else:
                reception.shake_hands(stream)
    (client,) = reception.by_node.values()
    clock.now_ns += HANDSHAKE_LIMIT_NS
    reception.expire(clock.now_ns)
    assert (client.closing_ns, len(reception.strangers)) == (None, 1)
    clock.now_ns += 1
    reception.expire(clock.now_ns)
    assert client.closing_ns == clock.now_ns
    assert (reception.refused, reception.strangers) == ({"handshake too slow": 2}, {})
    client.closing_ns, client.transmit, client.blocked_ns = None, client.receive, clock.now_ns
    reception.expire(clock.now_ns + SLOW_LIMIT_NS + 1)
    assert reception.refused["answers left unread"] == 1
    reception.close()
    for stream in (silent, half):
        stream.close()


def test_who_does_not_read_answers_is_not_read_and_nothing_piles_up(served: Served) -> None:
    deaf, other = client_of(served), client_of(served)
    deaf._transmit.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    question, asked = in_parts(Kind.CONTROL, b'{"op": "status"}'), 0
    try:
        while asked < 100_000:  # the bus stops reading long before
            deaf._transmit.sendall(question)
            asked += 1
    except BlockingIOError:
        pass
    client = served.server._by_node[deaf.node]
    assert asked < 100_000
    assert client.credits is not None
    assert client.credits.kept_bytes < 1 << 16
    assert "nodes" in other.control({"op": "status"})
    deaf.close()
    other.close()


def test_faults_beyond_what_the_computer_can_carry_out_slow_the_bus_down_and_nobody_else() -> None:
    served = Served(bitrate=1_000_000_000)  # a frame lasts less than its simulation
    one, other = client_of(served, node="one"), client_of(served, node="other")
    babble = {"babbles": [{"node": "one", "can_id": 0x100}], "bit_error_rate": 0.001}
    assert one.control({"op": "faults", "faults": babble}) == {"ok": True}
    slipped = 0
    while not slipped:
        slipped = other.control({"op": "status"})["slip_ns"]
    assert other.control({"op": "faults", "faults": {}}) == {"ok": True}
    while other.control({"op": "status"})["nodes"][0]["state"] == "bus off":
        pass
    one.close()
    other.close()
    served.server.stop()
    served.thread.join(WAIT_S)
    assert not served.thread.is_alive()
