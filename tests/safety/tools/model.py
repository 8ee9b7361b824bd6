"""The contract once more, as a small model in quanta of 50 ms: controller and link, one arrival per quantum.

It shares nothing with the code. tests/safety/checking.py finds every reachable state and replays every transition on the
real controller. What the model leaves out (dwell, the minute of the trips, torque values, plant faults) has tests of its
own at full resolution.
"""

from __future__ import annotations

from typing import NamedTuple

QUANTUM_MS = 50
OPERATE, CUT = 14, 4  # two verbs without gravity support, so that zero assist is zero torque
INPUTS = (
    "silence",
    "heartbeat",
    "hold",
    "act",
    "act_other",
    "act_unauthorised",
    "act_stale_echo",
    "act_forged",
    "act_disturbed",
    "corrupt",
    "duplicate",
    "stop",
    "own_id",
    "arm",
    "clear",
)
_COMMANDS = ("hold", "act", "act_other", "act_unauthorised", "act_stale_echo", "act_forged", "act_disturbed")


class Model(NamedTuple):
    """`window`: the last checks, G good, E error, O other. `command`, `heartbeat`: ages in quanta; None is not awaited."""

    mode: str = "FOLLOW"
    faulted: bool = False
    armed: bool = False
    neutral: int = 0
    machine: str = "NO_DATA"
    window: str = ""
    command: int | None = None
    heartbeat: int = 0
    trips: int = 0
    forged: int = 0
    verb: int = 0


def step(before: Model, arrival: str, at_zero: bool = False) -> Model:
    """One quantum: something arrives in its first millisecond, then 49 of them pass.

    A ramp that begins when an authorisation is missing lasts beyond the quantum, unless the assist was at zero by itself
    (`at_zero`): the damping of a still arm is, and then there is nothing to ramp.
    """
    m = before
    if m.command is not None:
        m = m._replace(command=m.command + 1)
    if m.armed:
        m = m._replace(heartbeat=m.heartbeat + 1)
    m, waiting = _arrives(m, arrival)
    if arrival == "clear" and before.mode in ("LATCHED", "ESTOP"):
        return m
    if before.mode == "SELFTEST" and m.mode == "SELFTEST":
        m = m._replace(mode="FOLLOW", neutral=0)
    if m.command == 2:
        overdue = m._replace(command=None, machine="INVALID", window="OOOO")
        m, waiting = _tripped(_disarmed(overdue)), False
    if m.armed and m.heartbeat == 5:
        m, waiting = _tripped(_disarmed(m)), False
    if not waiting or before.mode == "RAMP_DOWN":
        m = _ramped(m)
    if waiting:
        m = _ramped(_held(m)) if at_zero else _held(m)
    return m


def _arrives(m: Model, arrival: str) -> tuple[Model, bool]:
    """What the frame does at once; the flag says that an ACT now waits for its authorisation."""
    if arrival in _COMMANDS:
        return _commanded(m, arrival)
    if arrival == "stop":
        m = _latched(m, "ESTOP")
    elif arrival == "own_id":
        m = _latched(m, "LATCHED")
    elif arrival == "heartbeat":
        m = m._replace(heartbeat=0)
    elif arrival == "corrupt":
        m = _checked(m, "E")
    elif arrival == "duplicate" and m.machine != "NO_DATA":
        m = _checked(m, "O")
    elif arrival == "arm" and m.mode in ("FOLLOW", "READY"):
        m = m._replace(mode="FOLLOW", armed=True, neutral=0, heartbeat=0)
    elif arrival == "clear":  # brings its HOLD along; outside a latch that is all it is
        m = _commanded(m, "hold")[0]
        m = m._replace(mode="SELFTEST", trips=0, forged=0) if m.mode in ("LATCHED", "ESTOP") else m
    return m, False


def _checked(m: Model, result: str) -> Model:
    """The E2E machine; leaving VALID is a fault."""
    if m.machine == "NO_DATA":
        return m if result == "E" else m._replace(machine="INIT", window=result)
    window = (m.window + result)[-4:]
    good, errors, machine = window.count("G"), window.count("E"), m.machine
    if machine == "INIT":
        machine = "INVALID" if errors > 1 else "VALID" if good >= 2 else "INIT"
    elif machine == "VALID":
        machine = "INVALID" if errors > 1 or good == 0 else "VALID"
    elif errors == 0 and good >= 2:
        machine = "VALID"
    lost = m.machine == "VALID" and machine == "INVALID"
    m = m._replace(machine=machine, window=window)
    return _tripped(m._replace(neutral=0)) if lost else m


def _commanded(m: Model, what: str) -> tuple[Model, bool]:
    m = _checked(m, "G")
    trusted = m.machine == "VALID" and m.armed
    if what == "hold":
        m = _held(m._replace(command=0, neutral=min(m.neutral + 1, 3) if trusted else 0))
        return (m._replace(mode="READY") if m.mode == "FOLLOW" and m.neutral == 3 else m), False
    m = m._replace(neutral=0)
    if what == "act_disturbed":  # a stranger's plain ACT between an ACT and its ACT_AUTH: neither acts, nobody forged
        return _held(_checked(m._replace(command=0) if trusted else m, "G")), False
    if not trusted or what == "act_stale_echo":
        return _held(m), False
    if what == "act_unauthorised":
        return m, True
    if what == "act_forged":
        m = _held(m)._replace(forged=m.forged + 1)
        return (_latched(m, "LATCHED") if m.forged == 3 else m), False
    verb = CUT if what == "act_other" else OPERATE
    m = m._replace(command=0)
    if m.mode == "READY":
        return m._replace(mode="ASSIST", verb=verb), False
    return (_held(m) if m.mode == "ASSIST" and verb != m.verb else m), False


def _held(m: Model) -> Model:
    return m._replace(mode="RAMP_DOWN", faulted=False, verb=0) if m.mode == "ASSIST" else m


def _tripped(m: Model) -> Model:
    """A fault on the command path; it counts where an assist was on or one command away."""
    if m.mode not in ("READY", "ASSIST") and (m.mode != "RAMP_DOWN" or m.faulted):
        return m
    ready = m.mode == "READY"
    m = m._replace(mode="FOLLOW", neutral=0) if ready else m._replace(mode="RAMP_DOWN", faulted=True, verb=0)
    m = m._replace(trips=m.trips + 1)
    return _latched(m, "LATCHED") if m.trips == 3 else m


def _ramped(m: Model) -> Model:
    """A ramp that began in the first millisecond is over within the quantum."""
    if m.mode != "RAMP_DOWN":
        return m
    return m._replace(mode="FOLLOW", faulted=False, neutral=0) if m.faulted else m._replace(mode="READY")


def _disarmed(m: Model) -> Model:
    return m._replace(armed=False, neutral=0, heartbeat=0)


def _latched(m: Model, mode: str) -> Model:
    if m.mode == "ESTOP" or m.mode == mode:
        return m
    return _disarmed(m)._replace(mode=mode, faulted=False, verb=0)
