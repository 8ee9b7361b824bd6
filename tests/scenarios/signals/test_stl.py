"""hilscenario.signals.stl: the same robustness as rtamt's discrete-time monitor, and errors that show where."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilscenario.signals.stl import FormulaError, holds_now, judge, signal_names
from hilscenario.signals.trace import Trace, UnknownSignal, sample_and_hold

# Ours -> rtamt's words. Windows in samples (step 1 ms; rtamt counts samples).
PAIRS = [
    ("always x >= 0.5", "always(x >= 0.5)"),
    ("eventually x > 0.5", "eventually(x > 0.5)"),
    ("always[0, 3 ms] x <= y", "always[0,3](x <= y)"),
    ("eventually[1 ms, 4 ms] x > y", "eventually[1,4](x > y)"),
    ("always (x > 0 -> eventually[0, 3 ms] y > 0)", "always((x > 0) -> (eventually[0,3](y > 0)))"),
    ("always (x > 0 or not y > 0.2)", "always((x > 0) or (not (y > 0.2)))"),
    ("x < 0.5 until[0, 5 ms] y > 0.3", "(x < 0.5) until[0,5] (y > 0.3)"),
    ("x < 0.5 until[2 ms, 5 ms] y > 0.3", "(x < 0.5) until[2,5] (y > 0.3)"),
    ("always (once[0, 2 ms] x > 0 and y > -1)", "always((once[0,2](x > 0)) and (y > -1))"),
    ("always historically[0, 2 ms] x > -0.9", "always(historically[0,2](x > -0.9))"),
    ("eventually always x > 0", "eventually(always(x > 0))"),
]


def oracle(text: str, x: list[float], y: list[float]) -> float:
    rtamt = pytest.importorskip("rtamt", reason="rtamt does not import on Python 3.12 and later")
    specification = rtamt.StlDiscreteTimeSpecification()
    specification.declare_var("x", "float")
    specification.declare_var("y", "float")
    specification.declare_var("out", "float")
    specification.spec = f"out = {text}"
    specification.parse()
    rows = specification.evaluate({"time": list(range(len(x))), "x": x, "y": y})
    return float(rows[0][1])


samples = st.integers(8, 20).flatmap(
    lambda n: st.tuples(
        *[st.lists(st.floats(-1, 1, allow_nan=False).map(lambda v: round(v, 3)), min_size=n, max_size=n)] * 2
    )
)


@pytest.mark.parametrize(("ours", "theirs"), PAIRS)
@given(columns=samples)
@settings(max_examples=25, deadline=None)
def test_robustness_is_that_of_rtamt(ours: str, theirs: str, columns: tuple[list[float], list[float]]) -> None:
    x, y = columns
    trace = Trace(1.0, len(x), {"x": np.array(x), "y": np.array(y)})
    assert judge(ours, trace).robustness == pytest.approx(oracle(theirs, x, y), abs=1e-9)


@pytest.fixture
def trace() -> Trace:
    return sample_and_hold(
        {
            "gate.act": [(0, False), (4, True)],
            "device.state": [(0, "Follow"), (5, "Ready")],
            "device.assist_nm": [(0, 1.0), (10, 3.0)],
        },
        20,
    )


@pytest.mark.parametrize(
    ("formula", "robustness", "at_ms"),
    [
        ("always device.assist_nm <= 3.5", 0.5, 10),
        ("always device.assist_nm <= 2", -1.0, 10),
        ("always (rise(gate.act) -> eventually[0, 1 ms] device.state == Ready)", 1.0, 1),
        ("always (rise(gate.act) -> device.state == Ready)", -1.0, 4),
        ("eventually fall(gate.act)", -1.0, 0),
        ("device.state == Follow until[0, 1 s] device.state == Ready", 1.0, 0),
        ("always abs(device.assist_nm) != 2", 1.0, 0),
        ("gate.act", -1.0, 0),
        ("always[15 ms, 20 ms] device.assist_nm == 3", 0.0, 15),
        ("always[5 s, 6 s] gate.act", math.inf, 0),
    ],
)
def test_words_truths_edges_and_where_it_came_nearest(
    trace: Trace, formula: str, robustness: float, at_ms: float
) -> None:
    verdict = judge(formula, trace)
    assert verdict.robustness == pytest.approx(robustness)
    assert verdict.at_ms == at_ms
    assert verdict.holds is (robustness >= 0)


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("always device.assist_nm >=", "its end"),
        ("always (gate.act", "its end"),
        ("gate.act & gate.act", "column 10"),
        ("device.state > FOLLOW", "only be compared with == and !="),
        ("device.state > 3", "only be compared with == and !="),
        ("device.state", "compare it"),
        ("always[3 ms, 1 ms] gate.act", "end after it begins"),
        ("always[0, 1e999 ms] gate.act", "window [0 ms, inf ms]"),
        ("always[0, 1e999] gate.act", "no unit"),
        (f"always[0, {'9' * 400} ms] gate.act", "inf ms"),
        ("not " * 3000 + "gate.act", "at most 2000"),
        ("not " * 400 + "gate.act", "nested"),
    ],
)
def test_unreadable_formulas_say_where(trace: Trace, formula: str, said: str) -> None:
    with pytest.raises(FormulaError) as refused:
        judge(formula, trace)
    assert said in str(refused.value)


def test_a_misspelt_signal_gets_the_nearest_name(trace: Trace) -> None:
    with pytest.raises(UnknownSignal, match=r"no signal `device.stat`; did you mean `device.state`\?"):
        judge("always device.stat == READY", trace)
    assert signal_names("always (a.b -> c.d == WORD) and abs(e) < 3") == {"a.b", "c.d", "e"}


def test_conditions_on_one_sample() -> None:
    values: dict[str, float | str | bool] = {"device.state": "Assist", "gate.confidence": 0.7, "armed": True}
    assert holds_now("device.state == Assist and gate.confidence > 0.5 and armed", values)
    assert not holds_now("device.state == Ready", values)
    with pytest.raises(UnknownSignal):
        holds_now("nothing", values)


def test_values_hold_until_the_next_and_never_come_early() -> None:
    trace = sample_and_hold({"x": [(0, 1.0), (2.5, 2.0), (4.0, 3.0)]}, 5, initial={"y": 7.0})
    assert trace["x"].tolist() == [1, 1, 1, 2, 3, 3]
    assert trace["y"].tolist() == [7.0] * 6
