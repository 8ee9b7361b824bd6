"""A recording decided anew under several thresholds. `python examples/what_if.py out/demo/recording.mcap 0.6 0.7 0.8`."""

import sys
from pathlib import Path

from hilbridge.replay.again import Options, replay


def main(name: str, *thresholds: str) -> None:
    for tau_on in thresholds:
        asked = Options(what_if=(f"gate.tau_on={tau_on}", f"gate.tau_off={float(tau_on) - 0.1:.2f}"))
        told = replay(Path(name), asked).as_json()
        print(f"tau_on {tau_on}: {told['ticks_differing']} of {told['ticks']} ticks differ")


if __name__ == "__main__":
    main(*sys.argv[1:])
