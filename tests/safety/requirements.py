"""The trace: every hazard and number of the contract, and the tests that hold it; writes docs/safety.md when run.

A test names a hazard in its own name (`test_h2_...`) and requirements in its marker (`requirement("W1", ...)`). Tests are
found by reading their source, so that nothing has to be imported to trace them.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCUMENT = ROOT / "docs" / "safety.md"

HAZARDS = {
    "H1": "torque without intent",
    "H2": "torque persists",
    "H3": "abrupt loss under load",
    "H4": "excess torque, speed, range",
    "H5": "tremor amplified",
    "H6": "tremor taken for a reach",
    "H7": "chatter",
    "H8": "stale sensing",
    "H9": "silent degradation",
}

REQUIREMENTS = {
    "W1": "no accepted ACT_CMD for 100 ms: RAMP_DOWN, then FOLLOW",
    "W2": "no ACT_AUTH within 10 ms of an ACT: it counts as HOLD",
    "W3": "status echo older than 100 ms: the command counts as HOLD",
    "W4": "sensing older than 150 ms: the command counts as HOLD; the bridge holds by itself",
    "W5": "no bridge heartbeat for 250 ms: disarmed",
    "W6": "1 kHz control tick late by 5 ms of the device's own time: LATCHED",
    "W7": "assist for 10 s: RAMP_DOWN, and authorisation anew",
    "W8": "torque tracking, joint speed, range of motion: LATCHED",
    "W9": "bridge: no CTRL_STATUS for 60 ms: HOLD, session dropped",
    "W10": "bridge: runtime tick late by 40 ms: HOLD that tick, counted",
    "T1": "command lost: zero assist within 150 ms, at every phase",
    "T2": "HOLD: zero assist within 60 ms, at every phase",
    "T3": "STOP: zero assist within 20 ms, at every phase",
    "T4": "RAMP_DOWN takes at most 40 ms, STOP 10 ms, limited in jerk",
    "T5": "gravity support never falls faster than its 500 ms while sensors are healthy; else, and on STOP, at once",
    "T6": "assist rises by at most 10 N m/s",
    "T7": "assist rises by a limited amount within 250 ms",
    "T8": "assist stays below the cap of its verb; unknown verbs are never assisted",
    "T9": "authority, of assist and support, falls as the wearer opposes",
    "T10": "assist and gravity support are kept apart",
    "T11": "an ACT that nobody meant: at most 0.1 J into the arm and 30 mm at the hand, any verb, any wearer",
    "T12": "damping only ever removes energy; tremor of 3 to 12 Hz is never amplified",
    "S1": "one total transition table; what it does not list changes nothing",
    "S2": "FOLLOW to READY: armed, E2E VALID, three HOLDs in a row",
    "S3": "READY to ASSIST: one authorised ACT, and nothing else",
    "S4": "a change of verb goes through RAMP_DOWN",
    "S5": "after a fault FOLLOW, never straight back to ASSIST",
    "S6": "latches: 3 trips in 60 s, 3 MAC failures, second bus-off in 10 s, own identifier seen, self-test",
    "S7": "leaving a latch: zero torque, HOLD present, authenticated challenge, local action",
    "S8": "single E2E errors, one time-out, one bus-off recover alone",
    "S9": "no configuration disables a watchdog",
    "S10": "implausible sensors (angles, velocity, wearer's torque; counters leak): PASSIVE, no torque",
    "S11": "a stall of the computer is no device fault: caught up tick by tick, frames in order of arrival",
    "P1": "AUTOSAR E2E profile 5 and its state machine",
    "P2": "errors of one to three bits are always rejected",
    "P3": "STOP from any node, three times at 10 ms; any receipt stops",
    "P4": "gate coding: one flipped bit is never the other action",
    "P5": "ACT needs VALID, fresh echo, armed session, authentication, young sensing and a known verb",
    "P6": "authorisation: session keys, monotonic freshness, nothing replays across sessions",
    "P7": "stale frames of a dead bridge's queue produce zero assist",
    "P8": "only a fully accepted frame feeds a deadline",
    "P9": "decoding never raises; every drop is counted under its reason",
    "P10": "two codecs, one contract",
    "P11": "cycle times, start values, timeouts; status at once on a change of state",
    "P12": "key files 0600; the demo key is refused on a physical bus; listen-only sends nothing",
    "P13": "a hung bridge falls silent: nothing is sent by a periodic task",
    "P14": "one lost command passes without a trip",
}


def traced() -> dict[str, list[str]]:
    """Identifier -> tests that carry it, as `path::name`, over all test files."""
    found: dict[str, list[str]] = {entry: [] for entry in (*HAZARDS, *REQUIREMENTS)}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and node.name.startswith("test_"):
                for entry in _carried(node):
                    found.setdefault(entry, []).append(f"{path.relative_to(ROOT).as_posix()}::{node.name}")
    return found


def _carried(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    carried = [f"H{digit}" for digit in re.findall(r"_h(\d)(?=_)", node.name)]
    for decorator in node.decorator_list:
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func).split(".")[-1] == "requirement":
            carried += [argument.value for argument in decorator.args if isinstance(argument, ast.Constant)]
    return carried


def missing() -> list[str]:
    """Hazards and requirements that no test holds, and identifiers in tests that nobody knows."""
    known = {**HAZARDS, **REQUIREMENTS}
    found = traced()
    return [e for e in known if not found[e]] + [f"{e} (unknown)" for e in found if e not in known]


_HEAD = """# Safety: hazards, numbers, and what holds them

Generated, but for the threat model, by `python -m tests.safety.requirements` from the markers and names of the tests; a test
fails when this file is out of date or an entry has no test. The numbers are those of the bus protocol's safety contract.
Torque profiles await clinical sign-off; nothing here is a medical device, and no figure below has been measured on a person.

`make safety` runs the proofs that are too long for every change and prints one table; each part runs alone by
`python -m tests.safety PART`:

| Part | What it shows |
|---|---|
| `corruption` | all errors of one to three bits rejected, of four exactly the 64 unseen by profile 5; libraries agree |
| `conformance` | the bridge's DBC codec and the device's hand-written one agree: values, bytes, golden frames |
| `replay` | doubled frames, queues of a dead bridge, earlier sessions, replays past E2E and session number |
| `forgery` | random ACT and AUTH pairs that are right in all but the key; the third latches |
| `model` | all states of a model of the contract, all transitions replayed on the code, invariants per ms |
| `model_c` | the same search over the controller in C |
| `twin` | random sequences through the reference and the C: every number of state and outputs after every tick |
| `harm` | what a wrong ACT does: every verb, 21 wearers, firm and weak, ACTs of 0.24, 2 and 10 s; tremor; a search; a proof |
| `fuzz` | decode on both ends under random and coverage-guided input |
| `branches` | full branch coverage of the files that decide |
| `mutation` | a process per mutant; survivors argued one by one in `tests/safety/equivalent_mutants.json` |
| `defects` | 60 small defects at edges (attachment, node, senses, assembly, simulated bus): each found by the test named |
| `campaign` | 26 fault classes x 200 instants x 4 gate states on the whole system in lockstep; planted defects found |
| `hung` | bridge stopped, stalled, killed, link down and up, in real processes: time to zero assist |
| `server` | the simulated bus's process: fuzzed requests, hostile connections, impossible faults; an honest client |

What this does not show: that the model leaves nothing out (it has no dwell, no torque values and no plant faults; those
have tests of their own); that an interposer who withholds single frames for a multiple of 10.24 s while passing others
is harmless (docs/decisions/104); that wearers weaker than 2 N m/rad, or arms unlike the simulated one, are moved as little
(docs/decisions/109); that an ACT never takes an arm at the very edge of its range or speed over it, into a latch, which ends
follow mode; anything about hardware.
"""


def by_hand() -> str:
    """The part of docs/safety.md that people write: its threat model, from its title to the next."""
    text = DOCUMENT.read_text(encoding="utf-8")
    return text[text.index("## Threat model\n") : text.index("## Hazards\n")]


def absent() -> list[str]:
    """Tests that the part written by hand names and that there are not."""
    named = re.findall(r"`([\w/]+\.py)::(test_\w+)`", by_hand())
    files = {file: ROOT / "tests" / file for file, _ in named}
    text = {file: path.read_text(encoding="utf-8") if path.is_file() else "" for file, path in files.items()}
    return [f"{file}::{test}" for file, test in named if f"def {test}(" not in text[file]]


def document() -> str:
    """docs/safety.md as it must be."""
    found = traced()
    lines = [_HEAD, by_hand().rstrip(), ""]
    for title, entries in (("Hazards", HAZARDS), ("Requirements", REQUIREMENTS)):
        lines += [f"## {title}", "", "| | What | Tests |", "|---|---|---|"]
        for entry, what in entries.items():
            tests = [f"`{test.split('/', 1)[1]}`" for test in sorted(set(found[entry]))]
            lines.append(f"| {entry} | {what} | {'<br>'.join(tests)} |")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    DOCUMENT.write_text(document(), encoding="utf-8")
