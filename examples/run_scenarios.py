"""Scenarios from Python: the same dropout at several moments of an assist, in virtual time, with its margin."""

from hilscenario.format.files import scenario_of
from hilscenario.lockstep.run import run_scenario


def main() -> None:
    for at_ms in (4000, 6000, 8000):
        scenario = scenario_of(
            {
                "name": f"camera off at {at_ms / 1000:g} s",
                "duration": "12 s",
                "seed": 3,
                "intent": [{"at": "1 s", "verb": "Pour", "confidence": 0.97}],
                "steps": [{"at": f"{at_ms} ms", "fault": "camera.off", "for": "1 s"}],
                "expect": [{"figure": "zero_after_fault_ms", "at_most": 150}],
            }
        )
        result = run_scenario(scenario).result
        print(
            f"{'ok' if result.passed else 'FAILS':6}{scenario.name}: margin {result.robustness:.3f}", *result.problems()
        )


if __name__ == "__main__":
    main()
