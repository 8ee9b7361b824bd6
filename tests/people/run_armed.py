"""`hilbridge run --arm` with a bundle, on a simulated wearer's video and gaze, against a device in a process of its own.

    python -m tests.people.run_armed BUNDLE DIR [--bus hilsim:people] [--seconds 30] [--seed 32000]

The last step of the way from recordings to the bus (docs/learning.md); the bundle keeps whatever provenance it has.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from tests.people.before_a_camera import filmed

if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("bundle", type=Path)
    asked.add_argument("folder", type=Path)
    asked.add_argument("--bus", default="hilsim:people")
    asked.add_argument("--seconds", type=float, default=30.0)
    asked.add_argument("--seed", type=int, default=32_000)
    chosen = asked.parse_args()
    chosen.folder.mkdir(parents=True, exist_ok=True)
    video, gaze = filmed(chosen.folder, chosen.seed, chosen.seconds)
    device = subprocess.Popen(
        [sys.executable, "-m", "firmware_sim.node", "--bus", chosen.bus], stdout=subprocess.PIPE, text=True
    )
    try:
        if device.stdout is None or "ready" not in device.stdout.readline():
            sys.exit("the simulated device did not start")
        run = ["run", "--camera", str(video), "--gaze", str(gaze), "--no-hands", "--bus", chosen.bus, "--arm"]
        run += ["--bundle", str(chosen.bundle), "--out", str(chosen.folder / "run"), "--force"]
        ended = subprocess.run([sys.executable, "-m", "hilbridge.cli", *run], check=False)
    finally:
        device.kill()
        device.communicate()
    sys.exit(ended.returncode)
