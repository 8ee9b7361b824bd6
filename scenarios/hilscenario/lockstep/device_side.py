"""The device of a lockstep run: the controller at 1 kHz with its arm and motor, and faults of its world."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence

from firmware_sim.device import LOG_CYCLE_MS, Device
from firmware_sim.keys import WRONG
from firmware_sim.memory import Received
from firmware_sim.plant.actuator import LAG_S
from firmware_sim.secoc import DEMO_KEY
from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.simulated.protocol import Arrival
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.bus_side import BusSide
from hilscenario.lockstep.clock import WorldClock
from hilscenario.lockstep.controller import powered_on
from hilscenario.lockstep.probes import DeviceProbe
from hilscenario.lockstep.run_log import RunLog
from hilscenario.world.arm import PUSHING, opposing, push_nm
from hilscenario.world.device_faults import OVERRUN, RESTART, WRONG_KEY, acting, broken
from hilscenario.world.fault_board import Active, FaultBoard
from hilscenario.world.tap import Tap

_BUS_OFF = ErrorState.BUS_OFF


class DeviceSide:
    """The device between its controller chip and the wearer's arm. `chance` draws what its hardware would."""

    def __init__(self, scenario: Scenario, board: FaultBoard, bus: BusSide, log: RunLog, chance: random.Random) -> None:
        self._board, self._bus, self._chance = board, bus, chance
        self.device = Device(powered_on(DEMO_KEY, chance.getrandbits(32)), scenario.device.arm)
        self.tick_device = self.device.tick  # by name, so that a profile can wrap it
        self.coast_device = self.device.coast
        self.tap = Tap("device", board, scenario.seed)
        self.probe = DeviceProbe(log.tracks, log.record if log.is_recorded else None)
        self.dropped = 0  # frames that the controller chip did not take

    def tick(self, now_ns: int) -> None:
        """One millisecond of the device's own time, with what bus and faults have for it."""
        device, station = self.device, self._bus.device
        if not self._board.quiet:
            self._move_arm(now_ns)
        frames = _received(station.drain()) if station.inbox else ()
        device.bus_off = station.state is _BUS_OFF
        outgoing = self.tick_device(frames, self._chance.getrandbits(32), 0, self.dropped)
        if outgoing:
            self._send(outgoing, now_ns)
        self.probe.look(device, now_ns, frames)

    def coast(self, now_ns: int, most: int, clock: WorldClock) -> None:
        """At most so many milliseconds in which the bus has nothing for it and no fault is under way."""
        device = self.device
        before = device.ticks
        device.bus_off = self._bus.device.state is _BUS_OFF
        outgoing, path = self.coast_device(min(most, LOG_CYCLE_MS - before % LOG_CYCLE_MS), self.dropped)
        done = device.ticks - before
        self._chance.getrandbits(32 * done)  # of each tick, though only one with frames looks at it
        if done > 1:
            self.probe.pass_by(device, path, now_ns, clock.tick_ns)
            now_ns = clock.pass_ticks(done)
        if outgoing:
            self._send(outgoing, now_ns)
        self.probe.look(device, now_ns, ())

    def begin(self, active: Active) -> None:
        """A fault of the device or of the wearer's arm begins."""
        if active.step.fault == OVERRUN:
            self.device.skip(round(active["overrun_ms"]))
            active.took_effect()
        elif active.step.fault in (RESTART, WRONG_KEY):
            self._start_anew(WRONG if active.step.fault == WRONG_KEY else DEMO_KEY)
            active.took_effect()
        else:
            self._break()

    def end(self, active: Active) -> None:
        """... and ends."""
        if active.step.fault in PUSHING:
            self.device.wearer_extra_nm = 0.0  # the push of another fault comes back with the next tick
        elif active.step.fault == WRONG_KEY:
            self._start_anew(DEMO_KEY)
        else:
            self._break()

    def _start_anew(self, key: bytes) -> None:
        """Power lost and back: the controller remembers nothing; its arm is where it was."""
        self.device.start_anew(key, self._chance.getrandbits(32))

    def _break(self) -> None:
        wrong, device = broken(self._board), self.device
        device.encoder_offset_mdeg = wrong.encoder_offset_mdeg
        lag_s = LAG_S if wrong.lag_ms is None else wrong.lag_ms / 1000
        device.break_motor(lag_s=lag_s, bias_nm=wrong.bias_nm or 0.0)

    def _move_arm(self, now_ns: int) -> None:
        assist_unm = self.device.state.torque.assist_unm
        self.device.wearer_extra_nm = push_nm(self._board, assist_unm, now_ns)
        if (against := opposing(self._board, assist_unm)) is not None:
            against.took_effect()
        for active in acting(self._board, self.device.actuator.torque_nm != 0.0):
            active.took_effect()

    def _send(self, outgoing: Sequence[tuple[int, bytes]], now_ns: int) -> None:
        for can_id, data in outgoing:
            for when_ns, sent_id, sent_data in self.tap.send(can_id, data, now_ns):
                self._bus.put(self._bus.device, when_ns, sent_id, sent_data, self._drop)
        if (cut := self._board.get("bus.cut")) is not None:
            cut.took_effect()

    def _drop(self) -> None:
        self.dropped += 1


def _received(arrivals: Iterable[Arrival]) -> tuple[Received, ...]:
    return tuple(
        [
            Received(wire.can_id, wire.data, not (wire.is_extended or wire.is_fd or wire.is_remote))
            for wire, _, _, error, _ in arrivals
            if not error
        ]
    )
