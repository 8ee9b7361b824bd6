"""Defects for the reference controller, and the one line of the conformance test that has to find each."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import firmware_sim.controller
import firmware_sim.receive
from firmware_sim import e2e, frames, torque, transmit, watchdogs
from firmware_sim.law.memory import Torque
from firmware_sim.law.numbers import div
from firmware_sim.memory import ControllerState
from firmware_sim.receive import receive
from firmware_sim.states import TABLE, Event, State
from tests.safety.tools.planting import spoilt


@dataclass(frozen=True)
class Defect:
    """`places` are (owner, attribute or key, value); `lines` the cases that have to be broken, and no others may be."""

    name: str
    lines: frozenset[str]
    places: tuple[tuple[Any, Any, Any], ...]


class _EqualToAll:
    """A MAC that every other one is equal to."""

    def __eq__(self, other: object) -> bool:
        return True

    def __ne__(self, other: object) -> bool:
        return False

    __hash__ = None  # type: ignore[assignment]


def _slow_ramp(law: Torque, stride: int, velocity_mdeg_s: int) -> None:
    del stride, velocity_mdeg_s
    law.assist_unm = div(law.assist_unm * 98, 100)
    law.ramp_tick = 1


_check = e2e.check
_may_clear = firmware_sim.controller._may_clear


def _no_crc(can_id: int, data: bytes, before: e2e.Receiver) -> tuple[Any, e2e.Receiver]:
    return _check(can_id, e2e.protect(can_id, data, data[2]), before)


def _no_counter(can_id: int, data: bytes, before: e2e.Receiver) -> tuple[Any, e2e.Receiver]:
    result, after = _check(can_id, data, before)
    return (e2e.OK if result == e2e.REPEATED else result), after


def _any_length(state: ControllerState, frame: Any, random_u32: int, now_ms: int) -> None:
    receive(state, frame._replace(data=e2e.protect(frame.can_id, frame.data.ljust(8, b"\0"), frame.data[2]))
            if len(frame.data) == 7 else frame, random_u32, now_ms)  # fmt: skip


def _stop_of_data_frames(state: ControllerState, frame: Any, random_u32: int, now_ms: int) -> None:
    if frame.plain or frame.can_id != frames.STOP:
        receive(state, frame, random_u32, now_ms)


def _without_hand(state: ControllerState, now_ms: int) -> bool:
    return state.torque.assist_unm == 0 and state.torque.gravity_unm == 0 and state.command_live


def _of(name: str, line: str, *places: tuple[Any, Any, Any], also: tuple[str, ...] = ()) -> Defect:
    return Defect(name, frozenset({line, *also}), places)


DEFECTS = (
    _of("status every 60 ms", "status-period", (transmit, "STATUS_CYCLE_MS", 60), also=("stop-to-zero",)),
    _of("heartbeat every second", "heartbeat-period", (transmit, "HEARTBEAT_CYCLE_MS", 1000)),
    _of("one HOLD is neutral", "neutral-first", (watchdogs, "NEUTRAL_HOLDS", 1)),
    _of("a challenge lives for a minute", "response-late", (watchdogs, "CHALLENGE_LIMIT_MS", 60_000)),
    _of("no heartbeat watchdog", "heartbeat-silence", (watchdogs, "HEARTBEAT_LIMIT_MS", 10**9)),
    _of("an echo may be old", "echo-stale", (watchdogs, "ECHO_LIMIT_MS", 10_000)),
    _of("sensing may be old", "sensing-stale", (watchdogs, "SENSING_LIMIT_MS", 10_000), also=("sensing-stale-hold",)),
    _of("an ACT_AUTH may be late", "auth-late", (watchdogs, "AUTH_LIMIT_MS", 60), also=("auth-missing",)),
    _of("an assist may last", "dwell", (watchdogs, "DWELL_LIMIT_MS", 10**9)),
    _of("no CRC", "e2e-crc", (e2e, "check", _no_crc)),
    _of("repeated frames are new", "e2e-repetition", (e2e, "check", _no_counter)),
    _of("seven bytes are enough", "e2e-length", (firmware_sim.controller, "receive", _any_length)),
    _of(
        "any MAC is right",
        "mac-forged",
        (firmware_sim.receive.secoc, "act_mac", lambda *_: _EqualToAll()),
        also=(
            "act-altered",
            "three-macs",
        ),
    ),
    _of(
        "command watchdog of ten seconds",
        "silence-to-zero",
        (watchdogs, "COMMAND_LIMIT_MS", 10_000),
        also=(
            "response-late",
            "e2e-length",
            "command-deadline",
            "three-trips",
            "reset-without-hold",
        ),
    ),
    _of(
        "ramps of half a second",
        "hold-to-zero",
        (torque, "ramping", _slow_ramp),
        also=(
            "stop-to-zero",
            "silence-to-zero",
        ),
    ),
    _of("STOP is ignored in Assist", "stop-to-zero", (TABLE[State.ASSIST], Event.STOP, State.ASSIST)),
    _of("STOP of data frames only", "stop-forms", (firmware_sim.controller, "receive", _stop_of_data_frames)),
    _of("trips never latch", "three-trips", (watchdogs, "TRIP_LIMIT", 100)),
    _of("wrong MACs never latch", "three-macs", (watchdogs, "MAC_FAILURE_LIMIT", 100)),
    _of(
        "an own identifier is nothing",
        "own-identifier",
        (TABLE[State.READY], Event.LATCH, State.READY),
        also=("three-macs",),
    ),
    _of(
        "HOLD opens a latch",
        "latch-stays",
        (TABLE[State.LATCHED], Event.HOLD, State.SELFTEST),
        also=(
            "reset-without-hand",
            "reset-without-hold",
            "reset-unauthenticated",
            "reset-wrong-mac",
        ),
    ),
    _of(
        "a hand alone clears",
        "reset-unauthenticated",
        (firmware_sim.controller, "_may_clear", _without_hand),
        also=("reset-wrong-mac",),
    ),
    _of(
        "straight from RAMP_DOWN to the next verb",
        "verb-change",
        (TABLE[State.ASSIST], Event.VERB_CHANGE, State.ASSIST),
    ),
)


def planted(defect: Defect) -> AbstractContextManager[None]:
    """The defect, for as long as this lasts."""
    return spoilt(defect.places)
