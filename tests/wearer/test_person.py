from itertools import pairwise

import numpy as np
import pytest

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import FRAME, STEP_NS
from hilbridge.limits import MS
from hilbridge.verbs import VERBS
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.shaking import Tremor
from hilbridge.wearer.timeline import BENCHMARK, DEMO, Timeline, bayes_posterior, cells, hiding, statistics

S = 1_000_000_000


def test_records_are_pure_functions_of_time():
    forward, backward = Wearer(5), Wearer(5)
    times = [round(k * 0.37 * S) for k in range(60)]
    first = [(forward.gaze(t), forward.hands(t), forward.truth(t), forward.arm_intention(t)) for t in times]
    second = [(backward.gaze(t), backward.hands(t), backward.truth(t), backward.arm_intention(t)) for t in times[::-1]]
    assert first == second[::-1]
    assert (forward.frame(9 * S).rgb == backward.frame(9 * S).rgb).all()


def test_seeds_are_different_people():
    assert [e.verb for e in Wearer(1).events(60 * S)] != [e.verb for e in Wearer(2).events(60 * S)]
    assert (Wearer(1).frame(0).rgb != Wearer(2).frame(0).rgb).any()


def test_every_action_is_prepared_before_the_window_that_ends_half_a_second_before_it():
    events = Wearer(3).events(600 * S)
    assert len(events) > 100
    for before, after in pairwise(events):
        assert after.prepare_ns <= after.start_ns - 1_400 * MS
        assert before.prepare_ns < after.prepare_ns
        assert after.start_ns - before.start_ns >= 2_200 * MS - 1
        assert before.start_ns < before.end_ns


def test_transitions_follow_the_annotations():
    table = statistics()
    counts = np.zeros((len(VERBS), len(VERBS)))
    for seed in range(40):
        verbs = [event.verb for event in Wearer(seed).events(300 * S)]
        for before, after in pairwise(verbs):
            counts[before, after] += 1
    for verb in range(3):
        share = counts[verb] / counts[verb].sum()
        assert np.abs(share - table.transitions[verb]).max() < 0.05


def test_truth_names_what_is_under_way_and_what_comes():
    wearer = Wearer(4)
    for before, after in pairwise(wearer.events(60 * S)):
        during = wearer.truth(before.start_ns)
        assert during.current == before.verb
        assert during.following == after.verb
        assert during.onset_ns == after.start_ns
        preparing = wearer.truth(after.start_ns - 1)
        assert preparing.intended == after.verb
        assert preparing.is_right(after.verb)
        assert not preparing.is_right(len(VERBS))


def test_each_verb_has_cells_of_its_own():
    for interaction in (False, True):
        owned = [cell for own in cells(interaction) for cell in own]
        assert len(cells(interaction)) == len(VERBS)
        assert len(owned) == len(set(owned))
    for part in range(2):
        # Neither colour nor pattern alone tells the three frequent verbs apart.
        assert [sorted(cell[part] for cell in own) for own in cells(True)[:3]] == [[0, 1, 2]] * 3


@pytest.mark.parametrize("difficulty", [DEMO, BENCHMARK])
def test_the_bayes_posterior_is_what_its_name_says(difficulty):
    rng = np.random.default_rng(0)
    prior = statistics().prior
    claimed, right = [], []
    for _ in range(20_000):
        clarity = difficulty.draw(rng)
        verb = int(rng.choice(len(prior), p=prior))
        shown = verb if rng.uniform() < clarity else int(rng.choice(len(prior), p=prior))
        posterior = bayes_posterior(shown, clarity, prior)
        assert posterior.sum() == pytest.approx(1.0)
        claimed.append(posterior.max())
        right.append(posterior.argmax() == verb)
    assert np.mean(claimed) == pytest.approx(np.mean(right), abs=0.01)


def test_a_small_picture_gives_the_features_of_a_large_one():
    small, large = Wearer(6, width_px=96, height_px=72), Wearer(6, width_px=640, height_px=480)
    one, other = FeatureAssembler(), FeatureAssembler()
    difference = []
    for step in range(100):
        t = step * STEP_NS
        a = one.update(small.frame(t), small.gaze(t), small.hands(t), t).values
        b = other.update(large.frame(t), large.gaze(t), large.hands(t), t).values
        difference.append(np.abs(a - b))
    assert np.max(difference, axis=0)[: FRAME.start].max() == 0.0
    assert np.sqrt(np.mean(np.square(difference), axis=0)).max() < 0.06
    assert np.mean(difference) < 0.01


def test_tremor_shakes_hands_and_arm_at_its_frequency():
    calm, shaking = Wearer(8), Wearer(8, tremor=Tremor(6.0, amplitude=0.03))
    times = np.arange(0, 2 * S, 10 * MS)
    swing = np.array([shaking.arm_intention(int(t)).angle_deg - calm.arm_intention(int(t)).angle_deg for t in times])
    spectrum = np.abs(np.fft.rfft(swing))
    assert np.fft.rfftfreq(len(times), 0.01)[int(spectrum.argmax())] == pytest.approx(6.0, abs=0.5)
    assert shaking.hands(100 * MS) != calm.hands(100 * MS)
    assert shaking.truth(5 * S) == calm.truth(5 * S)


def test_arm_velocity_is_the_derivative_of_the_angle():
    wearer = Wearer(9)
    for t in range(2 * S, 6 * S, 333 * MS):
        rise = wearer.arm_intention(t + MS).angle_deg - wearer.arm_intention(t - MS).angle_deg
        assert wearer.arm_intention(t).velocity_deg_s == pytest.approx(rise / 0.002, abs=1.0)


def test_hidden_clarity_shows_in_nothing_and_changes_nothing_else():
    seen, hidden = (Timeline(5, one).until(1_200_000 * MS) for one in (BENCHMARK, hiding(BENCHMARK)))
    plain = [(one.verb, one.shown, one.clarity, one.cell, one.prepare_ns, one.start_ns, one.end_ns) for one in seen]
    assert plain == [(o.verb, o.shown, o.clarity, o.cell, o.prepare_ns, o.start_ns, o.end_ns) for o in hidden]
    assert all(one.strength == one.clarity for one in seen)
    clarity, strength = (np.array([getattr(one, name) for one in hidden]) for name in ("clarity", "strength"))
    assert abs(np.corrcoef(clarity, strength)[0, 1]) < 4.0 / np.sqrt(len(hidden))
    assert strength.std() > 0.2  # people still reach more or less far, for no reason


def test_with_hidden_clarity_the_mean_is_all_that_can_be_believed():
    shows = [
        one.shown == one.verb for seed in range(12) for one in Timeline(seed, hiding(BENCHMARK)).until(900_000 * MS)
    ]
    prior = statistics().prior
    expected = BENCHMARK.mean + (1.0 - BENCHMARK.mean) * float((prior**2).sum())
    assert np.mean(shows) == pytest.approx(expected, abs=4.0 * 0.5 / np.sqrt(len(shows)))
