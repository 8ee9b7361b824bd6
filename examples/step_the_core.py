"""The bridge's decisions on features of one's own: here those of a simulated wearer, without sensors, bus or clock."""

from collections import Counter

from hilbridge.api import Action, Stepper
from hilbridge.features.assembler import FeatureAssembler
from hilbridge.wearer.person import Wearer

TICK_NS = 40_000_000


def main(seconds: float = 20.0) -> None:
    stepper, wearer, assembler = Stepper(), Wearer(3), FeatureAssembler()
    said: Counter[str] = Counter()
    for tick in range(1, round(seconds * 25)):
        now_ns = tick * TICK_NS
        seen = wearer.frame(now_ns), wearer.gaze(now_ns), wearer.hands(now_ns)
        step = stepper.step(assembler.update(*seen, now_ns), now_ns)
        said[f"ACT {step.verb}" if step.decision.action is Action.ACT else f"HOLD {step.decision.reason}"] += 1
    for what, ticks in said.most_common():
        print(f"{ticks / 25:5.2f} s  {what}")


if __name__ == "__main__":
    main()
