"""A zero that wanders: as many waves as it needs, and none as fast as the drive."""

from dataclasses import replace

import numpy as np
import pytest
from test_modes import plays
from test_rivals import added

import preisach_jax as pj
from preisach_jax.diagnosis.growth import grown
from preisach_jax.diagnosis.step import Step
from preisach_jax.effects.drift import Drift
from preisach_jax.fit import begun, double_precision

RATE, COUNT, TURN_S = 200.0, 4000, 0.25


class SixWaves(Drift):
    """A wander that is looked for with few waves only."""

    def variants(self, survey):
        return (replace(self.bound_to(survey), waves=6),)


@pytest.fixture(scope="module", autouse=True)
def in_double_precision():
    with double_precision():
        yield


def wandering(turn_s):
    """A step whose drift has six waves, beside a stage whose zero wanders in ten."""
    rng = np.random.default_rng(3)
    time, every = np.arange(COUNT) / RATE, round(turn_s * RATE)
    turns = np.arange(0, COUNT + every, every)
    u = np.interp(np.arange(COUNT), turns, 10.0 * (np.arange(len(turns)) % 2))
    u = u * (0.7 + 0.3 * np.cos(0.4 * time))
    phases = 2 * np.pi * rng.uniform(size=10)
    slow = (0.1 * np.cos(np.pi * k * time / time[-1] + p) for k, p in enumerate(phases, start=1))
    z = plays(u) + sum(slow) + rng.normal(0, 0.01, COUNT)
    record, problem, point = begun(pj.Record.from_arrays(time, u, z), 13)
    return added(Step(record, problem, problem, (SixWaves(),), (point,)), SixWaves())


def test_a_wander_gets_the_waves_that_its_first_ones_leave():
    step = wandering(TURN_S)
    larger = grown(step)
    assert larger is not None
    assert isinstance(drift := larger.now.chain.effect("drift"), Drift)
    assert drift.waves == 12
    assert larger.now.validation_mean_square < 0.9 * step.now.validation_mean_square
    assert [each.trial.effect for each in larger.named] == [drift]


def test_a_wander_gets_no_waves_as_fast_as_the_drive():
    # Twelve waves in 20 s have periods down to 3.3 s; the drive comes back more seldom.
    assert grown(wandering(2.5)) is None
