"""A device whose arm is on the plant bus: the controller stepped on readings that arrive, torque sent back.

Readings arrive every millisecond, but never quite evenly. Each tick takes the next that waits; where none has come, the
encoder is carried on by the velocity. After 5 ms without any there are no sensors, and the controller is told so: it goes to
PASSIVE, without torque.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from firmware_sim.bench.wire import ANGLE_IDS, MOTION_IDS, TORQUE_ID, Reading, Torque, read_step, torque_frame
from firmware_sim.controllers import name_of, power_on, step_of
from firmware_sim.device import record_of
from firmware_sim.memory import ControllerState, Inputs, Received

SILENT_TICKS = 5
MOST_WAITING = 20  # readings; more are older than the plant's own patience
LOOK_TICKS = 250  # so often one reading is left out where one more than needed has waited all the time
NO_ANGLE_MDEG = 8_388_607  # no arm is there


class RemoteDevice:
    """Takes the place of firmware_sim.device.Device in a node. Faults of arm and motor are the plant's, not ours."""

    def __init__(self, state: ControllerState) -> None:
        self.state = state
        self._advance = step_of(state)
        self.local_clear = False
        self.bus_off = False
        self.ticks = 0
        self.skipped_ms = 0
        self.peak_assist_unm = 0
        self.missed = 0  # ticks without a new reading
        self.dropped = 0  # readings that came too late to be of use
        self._inputs = Inputs()
        self._commanded_unm = 0
        self._dropped_seen = 0
        self._angle = b""
        self._waiting: deque[tuple[int, Reading]] = deque()
        self._reading = Reading(NO_ANGLE_MDEG, NO_ANGLE_MDEG)
        self._echo, self._counter = 0, 0
        self._silent_ticks = SILENT_TICKS + 1
        self._least_waiting = 0

    def hear(self, can_id: int, data: bytes) -> None:
        """A frame of the plant bus."""
        if can_id == ANGLE_IDS[0]:
            self._angle = data
        elif can_id == MOTION_IDS[0] and (pair := read_step(self._angle, data)) is not None:
            self._waiting.append(pair)
            if len(self._waiting) > MOST_WAITING:
                self.dropped += len(self._waiting) - 1
                self._waiting = deque([pair])

    def answer(self) -> tuple[int, bytes]:
        """The torque of the last tick, for the plant."""
        self._counter = (self._counter + 1) & 0xFF
        return TORQUE_ID, torque_frame(Torque(self._counter, self._echo, (self._commanded_unm, 0)))

    def _read(self) -> Reading:
        if self._waiting:
            if self._silent_ticks > SILENT_TICKS:  # what has gathered before the first is no present
                self._waiting = deque([self._waiting[-1]])
            self._echo, self._reading = self._waiting.popleft()
            self._silent_ticks = 0
            self._catch_up()
            return self._reading
        self._least_waiting = 0
        self.missed += 1
        self._silent_ticks += 1
        if self._silent_ticks > SILENT_TICKS:
            return Reading(NO_ANGLE_MDEG, -NO_ANGLE_MDEG)
        moved = self._reading.velocity_mdeg_s // 1000
        one = self._reading
        self._reading = one._replace(
            angle_mdeg=one.angle_mdeg + moved, second_angle_mdeg=one.second_angle_mdeg + moved, hand=False
        )
        return self._reading

    def _catch_up(self) -> None:
        """Readings that always wait only make the answer older: leave one out now and then."""
        self._least_waiting = min(self._least_waiting, len(self._waiting))
        if self.ticks % LOOK_TICKS == 0:
            if self._least_waiting > 0:
                self._waiting.popleft()
                self.dropped += 1
            self._least_waiting = len(self._waiting)

    def tick(
        self, frames: tuple[Received, ...], random_u32: int, stall_ticks: int = 0, dropped: int = 0
    ) -> tuple[tuple[int, bytes], ...]:
        """As Device.tick."""
        self.ticks += 1
        state, inputs, reading = self.state, self._inputs, self._read()
        inputs.frames = frames
        inputs.angle_mdeg = reading.angle_mdeg
        inputs.second_angle_mdeg = reading.second_angle_mdeg
        inputs.velocity_mdeg_s = reading.velocity_mdeg_s
        inputs.user_torque_unm = reading.user_torque_unm
        inputs.measured_unm = reading.measured_unm
        inputs.commanded_unm = self._commanded_unm
        inputs.random_u32 = random_u32
        inputs.bus_off = self.bus_off
        inputs.local_clear = self.local_clear or reading.hand
        inputs.stall_ticks = stall_ticks
        inputs.tx_dropped = dropped - self._dropped_seen
        self._dropped_seen, self.local_clear = dropped, False
        self._advance(state, inputs, self.ticks + self.skipped_ms)
        law = state.torque
        self.peak_assist_unm = max(self.peak_assist_unm, abs(law.assist_unm))
        self._commanded_unm = law.assist_unm + law.gravity_unm + state.follow_unm
        return state.outbox

    def skip(self, milliseconds: int) -> None:
        """As Device.skip."""
        self.skipped_ms += milliseconds

    def start_anew(self, key: bytes, boot_nonce: int) -> None:
        """As Device.start_anew."""
        state = self.state
        self.state = power_on(name_of(state), key, boot_nonce, state.limits, state.profiles)

    def record(self) -> dict[str, Any]:
        """As Device.record; angle and velocity are the plant's readings."""
        return record_of(self.state, self._reading.angle_mdeg / 1000, self._reading.velocity_mdeg_s / 1000)
