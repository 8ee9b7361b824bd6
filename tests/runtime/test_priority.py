"""What runs in time looks at nothing for long: the collector leaves alone what a process began with."""

from __future__ import annotations

import os
import subprocess
import sys
from types import ModuleType

import pytest

import firmware_sim.priority
import hilbridge.priority

# A full collection looks at what is left: with the libraries' objects that was 90,000, and a second of no ticks in a
# process that shares them with the one it was forked from.
FEW = 5_000
BEGUN = """
import gc, {program}
from {priority} import use_realtime_scheduling
gc.set_threshold(0)  # none by chance between the two counts
before = len(gc.get_objects())
use_realtime_scheduling()
print(before, len(gc.get_objects()))
"""


@pytest.mark.parametrize(
    ("program", "priority"), [("hilbridge.run", "hilbridge.priority"), ("firmware_sim.node", "firmware_sim.priority")]
)
def test_h2_a_full_collection_has_little_to_look_at_once_the_loop_runs(program: str, priority: str) -> None:
    code = BEGUN.format(program=program, priority=priority)
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    before, left = map(int, said.split())
    assert before > FEW > left


@pytest.mark.skipif(sys.platform != "linux", reason="real time is Linux's here")
@pytest.mark.parametrize("module", [hilbridge.priority, firmware_sim.priority])
@pytest.mark.parametrize("processors", [1, 2])
def test_who_has_one_processor_of_many_leaves_it_to_the_others_too(
    module: ModuleType, processors: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(processors)))
    monkeypatch.setattr(os, "sched_setscheduler", lambda process, policy, param: asked.append(param.sched_priority))
    monkeypatch.setattr(module.gc, "freeze", lambda: None)
    monkeypatch.setattr(hilbridge.priority._Granted, "value", False)
    assert module.use_realtime_scheduling() is (processors > 1)
    assert len(asked) == processors - 1
