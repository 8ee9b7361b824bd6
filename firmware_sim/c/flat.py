"""A ControllerState as whole numbers in a fixed order, and back: how the reference and the C are compared and exchanged.

The order is that of flat.c; what is not there (None, beyond a count) is zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from itertools import islice
from operator import attrgetter, is_not
from typing import Any

from firmware_sim import e2e, frames, memory, states, watchdogs
from firmware_sim.law.memory import Torque
from firmware_sim.memory import Challenge, Command, ControllerState, PendingAct

PLAIN = (
    "boot_nonce", "last_tick_ms", "state", "reason", "ramp_fault", "verb", "assist_since_ms", "self_test_ms",
    "command_live", "command_ms", "command_is_hold", "accepted_counter", "neutral", "armed", "session", "freshness",
    "mac_checked", "heartbeat_ms", "last_session", "handshake_rest_ms", "refusal", "clear_until_ms", "was_bus_off",
    "mac_failures",
    "tracking_doubt", "sensor_doubt", "healthy_ticks", "previous_user_unm", "status_due_ms", "meas_due_ms",
    "heartbeat_due_ms", "diag_due_ms", "diag_index", "emergencies", "follow_unm",
)  # fmt: skip
LAW = tuple(field.name for field in fields(Torque) if field.name != "peaks")
_BOOLEAN = ("ramp_fault", "command_live", "command_is_hold", "armed", "mac_checked", "was_bus_off")
_SLOTS = len(frames.RECEIVED_IDS)
_plain = attrgetter(*PLAIN)
_law = attrgetter(*LAW)
_immutable = attrgetter(
    "receivers", "pending", "commands", "echoes", "shared_key", "key", "challenge", "limits", "trips", "bus_offs"
)


def _word(data: bytes) -> int:
    return int.from_bytes(data, "little", signed=True)


def _key(key: bytes) -> tuple[int, int]:
    whole = key.ljust(16, b"\0")
    return _word(whole[:8]), _word(whole[8:])


def _receiver(one: e2e.Receiver) -> tuple[int, ...]:
    window = (*one.window, 0, 0, 0, 0)[: e2e.WINDOW]
    return (one.counter is not None, one.counter or 0, one.machine, len(one.window), *window, one.lost)


def _table(rows: list[tuple[int, ...]], slots: int, width: int) -> tuple[int, ...]:
    """How many there are, then so many rows, those that are free as zeros."""
    flat = tuple(value for row in rows for value in row)
    return (len(rows), *flat, *(0,) * (width * slots - len(flat)))


def _tail(state: ControllerState) -> tuple[int, ...]:
    """All that seldom changes, and is immutable."""
    pending, challenge, limits = state.pending, state.challenge, state.limits
    return (
        *(value for one in state.receivers for value in _receiver(one)),
        *((0,) * 5 if pending is None else (1, pending[0], _word(pending[1]), pending[2], pending[3])),
        *_table([(at, _word(data), waited) for at, data, waited in state.commands], memory.COMMAND_SLOTS, 3),
        *_table(list(state.echoes), memory.ECHO_SLOTS, 2),
        *_key(state.shared_key),
        *_key(state.key),
        *((0,) * 7 if challenge is None else (1, *challenge)),
        limits.angle_low_mdeg,
        limits.angle_high_mdeg,
        limits.speed_limit_mdeg_s,
        limits.tracking_limit_unm,
        *_table([(at,) for at in state.trips], watchdogs.TRIP_LIMIT, 1),
        *_table([(at,) for at in state.bus_offs], watchdogs.BUS_OFF_LIMIT, 1),
    )


class Flattener:
    """Gives the numbers of one state after another; what is still the same object is not taken apart again."""

    def __init__(self) -> None:
        self._known: tuple[object, ...] = ()
        self._numbers: tuple[int, ...] = ()

    def __call__(self, state: ControllerState) -> tuple[int, ...]:
        """The numbers of a state."""
        law, outbox = state.torque, state.outbox
        parts = _immutable(state)
        if len(parts) != len(self._known) or any(map(is_not, parts, self._known)):
            self._known, self._numbers = parts, _tail(state)
        return (
            *_plain(state),
            state.previous_mdeg is not None,
            state.previous_mdeg or 0,
            *_law(law),
            *law.peaks,
            *state.counters,
            *state.tx_counters,
            *self._numbers,
            len(outbox),
            *((number for can_id, data in outbox for number in (can_id, _word(data))) if outbox else ()),
        )


def flat(state: ControllerState) -> tuple[int, ...]:
    """The numbers of a state."""
    return Flattener()(state)


class _Reader:
    """Takes the numbers off one after the other."""

    def __init__(self, numbers: tuple[int, ...]) -> None:
        self._left: Iterator[int] = iter(numbers)

    def take(self, count: int) -> tuple[int, ...]:
        return tuple(islice(self._left, count))

    def one(self) -> int:
        return next(self._left)

    def data(self, length: int = 8) -> bytes:
        return b"".join(word.to_bytes(8, "little", signed=True) for word in self.take(length // 8))

    def rows(self, slots: int, width: int) -> list[tuple[int, ...]]:
        count = self.one()
        numbers = self.take(slots * width)
        return [numbers[at * width : (at + 1) * width] for at in range(count)]

    def receiver(self) -> e2e.Receiver:
        seen, counter, machine, filled, *window, lost = self.take(5 + e2e.WINDOW)
        checks = tuple(e2e.Check(check) for check in window[:filled])
        return e2e.Receiver(counter if seen else None, e2e.Machine(machine), checks, lost)

    def pending(self) -> PendingAct | None:
        waits, arrived_ms, data, verb, counter = self.take(5)
        return PendingAct(arrived_ms, _bytes(data), verb, counter) if waits else None

    def challenge(self) -> Challenge | None:
        is_open, sent_ms, purpose, session, bridge_nonce, device_nonce, disturbed = self.take(7)
        found = Challenge(sent_ms, purpose, session, bridge_nonce, device_nonce, bool(disturbed))
        return found if is_open else None


def _bytes(word: int) -> bytes:
    return word.to_bytes(8, "little", signed=True)


def state_of(numbers: tuple[int, ...]) -> ControllerState:
    """The state that has these numbers."""
    reader = _Reader(numbers)
    plain: dict[str, Any] = dict(zip(PLAIN, reader.take(len(PLAIN)), strict=True))
    plain.update({name: bool(plain[name]) for name in _BOOLEAN})
    plain["state"], plain["reason"] = states.State(plain["state"]), states.Reason(plain["reason"])
    plain["refusal"] = memory.Refusal(plain["refusal"])
    moved, previous_mdeg = reader.take(2)
    plain["previous_mdeg"] = previous_mdeg if moved else None
    law: dict[str, Any] = dict(zip(LAW, reader.take(len(LAW)), strict=True))
    law["wave_up"] = bool(law["wave_up"])
    plain["torque"] = Torque(**law, peaks=reader.take(len(Torque().peaks)))
    plain["counters"] = reader.take(memory.COUNTERS)
    plain["tx_counters"] = reader.take(len(frames.OWN_IDS))
    plain["receivers"] = tuple(reader.receiver() for _ in range(_SLOTS))
    plain["pending"] = reader.pending()
    commands = reader.rows(memory.COMMAND_SLOTS, 3)
    plain["commands"] = tuple(Command(at, _bytes(data), bool(waited)) for at, data, waited in commands)
    plain["echoes"] = tuple((counter, at) for counter, at in reader.rows(memory.ECHO_SLOTS, 2))
    shared_key, key = reader.data(16), reader.data(16)
    plain["key"] = key if plain["armed"] else b""
    plain["challenge"] = reader.challenge()
    plain["limits"] = watchdogs.Limits(*reader.take(4))
    plain["trips"] = tuple(at for (at,) in reader.rows(watchdogs.TRIP_LIMIT, 1))
    plain["bus_offs"] = tuple(at for (at,) in reader.rows(watchdogs.BUS_OFF_LIMIT, 1))
    sent = reader.one()
    plain["outbox"] = tuple((reader.one(), _bytes(reader.one())) for _ in range(sent))
    return ControllerState(shared_key=shared_key, **plain)
