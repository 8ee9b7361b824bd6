"""The lockstep engine: bridge, predictor, bit-level bus, controller at 1 kHz, arm and wearer on one time line.

Every part is the code that runs live; only clock and sockets are the engine's. Time is the world's, in ns from 0; the
device's clock runs off by the scenario's ppm. The same scenario and seed give the same run, to the byte.

What happens now and then waits on a heap. The device's tick, of which there are a thousand a second, takes its turn
among them without being put there; what it calls costs next to nothing while nothing has changed.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Sequence

from firmware_sim.device import Device
from firmware_sim.memory import COUNT_LOST, ControllerState, Received
from firmware_sim.plant.actuator import LAG_S
from firmware_sim.secoc import DEMO_KEY
from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.faults import Corruption, Where, WireCut, WireFaults
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.network import Network, Station
from hilbridge.bus.simulated.protocol import Arrival
from hilbridge.rows import EventRow, Row
from scenarios.format.schema import Scenario
from scenarios.format.vocabulary import fault_kind
from scenarios.lockstep.bridge_side import BridgeSide
from scenarios.lockstep.clock import WorldClock
from scenarios.lockstep.intruder import Intruder
from scenarios.lockstep.probes import DeviceProbe
from scenarios.signals.device import DEVICE_COUNTERS
from scenarios.signals.stl import holds_now, signal_names
from scenarios.signals.tracks import Tracks
from scenarios.world.arm import tremor_torque_nm
from scenarios.world.fault_board import FOREVER_NS, Active, FaultBoard
from scenarios.world.sensing import Body
from scenarios.world.tap import Tap

MS = 1_000_000
Record = Callable[[Row], None]
_EVERYBODY = frozenset({"bridge", "device", "intruder"})
_SENT_BY_BRIDGE = (0x060, 0x061, 0x120, 0x300)
_DEVICE_FAULTS = ("device.sensor_fault", "device.actuator_lag", "device.torque_bias")
_BUS_OFF = ErrorState.BUS_OFF
_QUEUED = Enqueued.QUEUED


class Lockstep:
    """One run. `run()` once; `tracks`, `board`, `device` and `bridge` tell what happened."""

    def __init__(self, scenario: Scenario, record: Record | None = None) -> None:
        """`record` takes the rows of a recording; without it those of frames and of the device are not even made."""
        self.scenario = scenario
        self.clock = WorldClock()
        self.tracks = Tracks()
        self.board = FaultBoard(scenario.steps)
        self.record = _unrecorded if record is None else record
        self.is_recorded = record is not None
        self.body = Body(scenario, self.board)
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._order = 0
        self._random = random.Random(scenario.seed)
        faults = WireFaults(seed=scenario.seed, bit_error_rate=scenario.bus.bit_error_rate)
        self.network = Network(Medium(scenario.bus.bitrate, faults=faults), self.clock)
        self.wire_effects: dict[str, int] = {}
        self._forcing_off: Active | None = None
        self._attach()
        self.bridge = BridgeSide(self, Tap("bridge", self.board, scenario.seed))
        self.intruder = Intruder(self, self.bridge.tap)
        self._tick_ns = round(MS * (1.0 + scenario.device.clock_ppm * 1e-6))
        self._waiting = {number for number, step in enumerate(scenario.steps) if step.when is not None}
        self._names = {number: signal_names(scenario.steps[number].when or "") for number in self._waiting}
        self._looked_at = -1

    def _attach(self) -> None:
        self.bridge_station = self.network.attach("bridge")
        self.device_station = self.network.attach("device")
        self.device = Device(ControllerState(DEMO_KEY, self._random.getrandbits(32)), self.scenario.device.arm)
        self.tick_device = self.device.tick  # by name, so that a profile can put its clock around a compiled one
        self.device_tap = Tap("device", self.board, self.scenario.seed)
        self.probe = DeviceProbe(self.tracks, self.record if self.is_recorded else None)
        self._device_dropped = 0

    # The heap

    def at(self, when_ns: int, do: Callable[[], None]) -> None:
        """Have something done at `when_ns` (or now, if that is past); first come, first served within one time."""
        heapq.heappush(self._heap, (max(when_ns, self.clock.time_ns), self._turn(), do))

    def _turn(self) -> int:
        """The next place in the order of those who come at one time."""
        self._order += 1
        return self._order

    def run(self) -> None:
        """From 0 to the scenario's end."""
        for number, step in enumerate(self.scenario.steps):
            if step.at is not None:
                self.at(step.at, self._striker(number))
        self.bridge.start()
        heap, clock, end_ns = self._heap, self.clock, self.scenario.duration
        tick = (self._tick_ns, self._turn())
        while True:
            if heap and heap[0] < tick:
                if heap[0][0] > end_ns:
                    break
                clock.time_ns, _, do = heapq.heappop(heap)
                do()
            elif tick[0] > end_ns:
                break
            else:
                clock.time_ns = tick[0]
                self._device_tick(tick[0])
                tick = (tick[0] + self._tick_ns, self._turn())
        clock.time_ns = end_ns

    def counters(self) -> dict[str, int]:
        """Everything that was counted on both sides and on the wire."""
        side = self.bridge
        device = {
            f"device.{name}": value for name, value in zip(DEVICE_COUNTERS, self.device.state.counters, strict=True)
        }
        wire = {f"wire.{name}": value for name, value in side.wire.counters.items()}
        self._keep_wire_effects()
        effects = {f"medium.{name}": times for name, times in sorted(self.wire_effects.items())}
        sent = {
            "bridge.send_failed": side.send_failed,
            "bridge.tap_lost": side.tap.lost,
            "device.send_dropped": self._device_dropped,
            "device.tap_lost": self.device_tap.lost,
            "intruder.send_dropped": self.intruder.dropped,
        }
        totals = {
            "frames_sent": side.frames_sent,
            "frames_received": side.frames_received,
            "frames_lost": self.frames_lost,
            "ticks_missed": side.ticks_missed,
        }
        return {**totals, **device, **wire, **effects, **sent}

    @property
    def frames_lost(self) -> int:
        """Frames that one side sent and the other knows it missed."""
        return self.device.state.counters[COUNT_LOST] + self.bridge.frames_lost

    # Faults

    def _striker(self, number: int) -> Callable[[], None]:
        return lambda: self.strike(number)

    def strike(self, number: int) -> None:
        """Begin a step, plan its end and its next time."""
        now_ns, step = self.clock.time_ns, self.scenario.steps[number]
        active = self.board.strike(number, now_ns)
        self._note_faults()
        self.record(EventRow(now_ns, f"fault: {step.fault} begins"))
        self._begin(active)
        if step.for_ is not None:
            self.at(now_ns + step.for_, lambda: self._finish(number))
        elif fault_kind(step.fault).instant:
            # An instant is over at once; its mark stays for a millisecond, so that expectations can see it.
            self.at(now_ns + MS, lambda: self._finish(number))
        if step.every is not None:
            self.at(now_ns + step.every, self._striker(number))

    def _finish(self, number: int) -> None:
        active = self.board.end(number)
        if self.board.quiet:
            self.device.wearer_extra_nm = 0.0
        self._note_faults()
        self.record(EventRow(self.clock.time_ns, f"fault: {active.step.fault} ends"))
        self._end(active)

    def _note_faults(self) -> None:
        time_ms = self.clock.time_ns / MS
        for name, value in self.board.signals().items():
            self.tracks.put(time_ms, name, value)

    def _begin(self, active: Active) -> None:
        fault = active.step.fault
        if fault.startswith("bridge."):
            self.bridge.begin(active)
        elif fault in ("bus.babble", "bus.replay", "bus.forge", "bus.stop"):
            self.intruder.begin(active)
        elif fault == "bus.cut":
            self._use_wire()
        elif fault == "bus.bus_off":
            # Every frame of the bridge destroyed 32 times in a row: TEC + 8 each, bus-off at 256.
            self._forcing_off = active
            self._use_wire()
        elif fault == "device.tick_overrun":
            self.device.skip(round(active["overrun_ms"]))
            active.took_effect()
        elif fault.startswith("device."):
            self._break_device()

    def _end(self, active: Active) -> None:
        fault = active.step.fault
        if fault.startswith("bridge."):
            self.bridge.end(active)
        elif fault == "bus.cut":
            self._use_wire()
        elif fault == "bus.stale_queue":
            self.intruder.release(self.bridge.tap.release())
        elif fault.startswith("device."):
            self._break_device()

    def _break_device(self) -> None:
        """The device's world as all its faults under way make it: one that ends leaves the others as they are."""
        sensor, lag, bias = map(self.board.get, _DEVICE_FAULTS)
        self.device.encoder_offset_mdeg = 0 if sensor is None else round(sensor["offset_deg"] * 1000)
        self.device.break_motor(
            lag_s=LAG_S if lag is None else lag["time_constant_ms"] / 1000,
            bias_nm=0.0 if bias is None else bias["bias_nm"],
        )

    def _use_wire(self) -> None:
        """The wire as all its faults under way make it, keeping count of what the old ones did."""
        self.network.pump()
        self._keep_wire_effects()
        cut, off = self.board.get("bus.cut"), self._forcing_off
        self.network.medium.use_faults(
            WireFaults(
                seed=self._random.getrandbits(32),
                bit_error_rate=self.scenario.bus.bit_error_rate,
                cuts=() if cut is None else (WireCut(_EVERYBODY, self.clock.time_ns, FOREVER_NS),),
                corruptions=()
                if off is None
                else tuple(Corruption(can_id, Where.CRC, count=40) for can_id in _SENT_BY_BRIDGE),
            )
        )

    def _keep_wire_effects(self) -> None:
        effects = self.network.medium.fault_state.effects
        for name, times in effects.items():
            self.wire_effects[name] = self.wire_effects.get(name, 0) + times
        effects.clear()

    def _look_for_conditions(self) -> None:
        if self._looked_at == self.tracks.version:
            return
        self._looked_at = self.tracks.version
        for number in sorted(self._waiting):
            step = self.scenario.steps[number]
            names, now = self._names[number], self.tracks.now
            if names <= now.keys() and holds_now(step.when or "", {name: now[name] for name in names}):
                self._waiting.discard(number)
                self.at(self.clock.time_ns + step.after, self._striker(number))

    # The device

    def _device_tick(self, now_ns: int) -> None:
        device, station, board = self.device, self.device_station, self.board
        if not board.quiet:
            self._wearers_arm(now_ns)
        if self.network.medium.due_ns <= now_ns:
            self.network.pump()
        frames = _received(station.drain()) if station.inbox else ()
        device.bus_off = station.state is _BUS_OFF
        outgoing = self.tick_device(frames, self._random.getrandbits(32), 0, self._device_dropped)
        if outgoing:
            self._send_devices(outgoing, now_ns)
        self.probe.look(device, now_ns, frames)
        self.bridge.poll(now_ns)
        if outgoing and (cut := board.get("bus.cut")) is not None:
            cut.took_effect()
        if self._waiting:
            self._look_for_conditions()

    def _send_devices(self, outgoing: Sequence[tuple[int, bytes]], now_ns: int) -> None:
        for can_id, data in outgoing:
            for when_ns, sent_id, sent_data in self.device_tap.send(can_id, data, now_ns):
                self.put_on_bus(self.device_station, when_ns, sent_id, sent_data, self._device_drop)

    def _device_drop(self) -> None:
        self._device_dropped += 1

    def _wearers_arm(self, now_ns: int) -> None:
        extra_nm = 0.0
        get = self.board.get
        if (opposing := get("wearer.opposing")) is not None and self.device.state.torque.assist_unm:
            extra_nm -= opposing["torque_nm"] * (1.0 if self.device.state.torque.assist_unm > 0 else -1.0)
            opposing.took_effect()
        if (tremor := get("wearer.tremor")) is not None:
            extra_nm += tremor_torque_nm(tremor, now_ns)
        self.device.wearer_extra_nm = extra_nm
        for fault in _DEVICE_FAULTS:
            # A lag does nothing to a motor that gives no torque.
            if (active := get(fault)) is not None and (
                fault != "device.actuator_lag" or self.device.actuator.torque_nm
            ):
                active.took_effect()

    # The bus

    def put_on_bus(self, station: Station, when_ns: int, can_id: int, data: bytes, dropped: Callable[[], None]) -> None:
        """Hand a frame to a controller chip, now or later; a full queue or a bus-off chip drops it, which is told."""
        if when_ns > self.clock.time_ns:
            self.at(when_ns, lambda: self.put_on_bus(station, when_ns, can_id, data, dropped))
        elif station.send(WireFrame(can_id, data)) is not _QUEUED:
            dropped()

    def bridge_is_off(self) -> None:
        """The bridge has seen that its controller chip is bus-off: a fault that forced it has taken effect."""
        if self._forcing_off is not None:
            self._forcing_off.took_effect()
            self._forcing_off = None
            self._use_wire()


def _received(arrivals: list[Arrival]) -> tuple[Received, ...]:
    return tuple(
        [
            Received(wire.can_id, wire.data, not (wire.is_extended or wire.is_fd or wire.is_remote))
            for wire, _, _, error, _ in arrivals
            if not error
        ]
    )


def _unrecorded(row: Row) -> None:
    """Where nobody keeps a recording."""
