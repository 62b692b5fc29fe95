"""What an unknown past takes up of a course of time, and what it takes to tell them apart."""

import numpy as np
import pytest

import preisach_jax as pj

CURVES, STEPS = 24, 25


def reversal_curves():
    """An input that comes from saturation, and returns from ever lower reversals."""
    course = [np.array([1.0])]
    for turn in np.linspace(0.6, -1.0, CURVES):
        course += [np.array([turn]), np.linspace(turn, 1.0, STEPS)[1:]]
    return np.concatenate(course)


def relays(u):
    """A stack of relays within -1 and 1 that were on before, with an output that loses 20 %."""
    rng = np.random.default_rng(3)
    up, down = np.sort(rng.uniform(-0.95, 0.95, (2, 4000)), axis=0)[::-1]
    state, total = np.ones(4000), np.empty(len(u))
    for k, value in enumerate(u):
        state = np.where(value >= up, 1.0, np.where(value <= down, -1.0, state))
        total[k] = state.mean() + 0.3 * value
    return total * np.linspace(1.0, 0.8, len(u)) + rng.normal(0, 5e-4, len(u))


@pytest.fixture(scope="module")
def measured():
    u = reversal_curves()
    time = np.arange(len(u)) * 0.5
    return lambda memory: pj.Record.from_arrays(time, u, relays(u), initial_memory=memory)


def test_an_unknown_past_is_told_where_it_hides_a_course_of_time(measured):
    found = pj.diagnose(measured("free"), ["drift", "ageing"], levels=9)
    (told,) = [note for note in found.notes if "--initial-memory high" in note]
    assert f"turns beyond all its values before {CURVES} times" in told


def test_with_a_stated_start_the_course_of_time_is_found(measured):
    found = pj.diagnose(measured("high"), ["drift", "ageing"], levels=9)
    assert set(found.findings[0].family) == {"drift", "ageing"}
    assert not [note for note in found.notes if "--initial-memory" in note]
