import ast
from pathlib import Path

import pytest

import hilbridge.monitor
from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.port.state import PortCounters, PortState, SendResult
from hilbridge.limits import STOP_GAP_NS
from hilbridge.monitor import station as module
from hilbridge.monitor.state import Watch
from hilbridge.monitor.station import Station
from hilbridge.records import Frame
from tests.monitor.made import CODEC


class Port:
    """Keeps what was sent, and when."""

    def __init__(self, result=SendResult.SENT):
        self.sent, self.result = [], result
        self.counters = PortCounters()
        self.state = PortState(True, ErrorState.ACTIVE, 0, 0, "", 0)

    def send(self, frame):
        self.sent.append(frame)
        return self.result


def station_on(port):
    return Station(port, Watch(CODEC, 0), CODEC, lambda: 0)


@pytest.fixture
def waited(monkeypatch):
    waits = []

    async def sleep(seconds):
        waits.append(seconds)

    monkeypatch.setattr(module.asyncio, "sleep", sleep)
    return waits


async def test_stop_is_three_empty_frames_ten_ms_apart(waited):
    port = Port()
    assert await station_on(port).stop() == ""
    assert port.sent == [Frame(0x001, b"")] * 3
    assert waited == [STOP_GAP_NS / 1e9] * 2


@pytest.mark.parametrize("result", [SendResult.DOWN, SendResult.LISTEN_ONLY, SendResult.FULL, SendResult.CLOSED])
async def test_a_stop_that_did_not_go_out_is_said(waited, result):
    told = await station_on(Port(result)).stop()
    assert told.startswith("STOP did not go out 3 of 3 times")


def test_changes_are_reported_once():
    station, seen = station_on(Port()), []
    station.on_change = lambda: seen.append(1)
    station.look()
    station.look()
    assert seen == [1]


def test_nothing_in_the_room_can_send_but_stop():
    """One method calls a port's `send`, with the one frame that it was built with; no encoder of ours is used."""
    room = Path(hilbridge.monitor.__file__).parent
    calls = []
    for path in room.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and node.attr in (
                "send",
                "encode",
                "send_periodic",
                "write",
                "_backend",
            ):
                calls.append((path.name, node.attr, ast.unparse(node)))
    assert [call for call in calls if call[1] != "encode" or "token" not in call[2]] == [
        ("station.py", "send", "self._port.send")
    ] * 2
    source = ast.parse((room / "station.py").read_text())
    sends = [n for n in ast.walk(source) if isinstance(n, ast.Call) and ast.unparse(n.func) == "self._port.send"]
    assert {ast.unparse(call) for call in sends} == {"self._port.send(self._stop)"}
    built = [
        ast.unparse(n) for n in ast.walk(source) if isinstance(n, ast.Assign) and "_stop" in ast.unparse(n.targets[0])
    ]
    assert built == ["self._stop = Frame(codec.messages['STOP'].can_id, b'')"]
