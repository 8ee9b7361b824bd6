"""What runs in time looks at nothing for long: the collector leaves alone what a process began with."""

from __future__ import annotations

import subprocess
import sys

import pytest

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
