"""Terms of an effect: found beside another effect, needless by now, and as many as it needs."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from found import LEVELS, ROWS
from test_modes import RATE, drive, lagging, plays, through
from test_rivals import added

import preisach_jax as pj
from preisach_jax.diagnosis.growth import (
    grown,
    in_best_forms,
    with_larger_beside,
    without_needless_modes,
)
from preisach_jax.diagnosis.step import Named, Step
from preisach_jax.effects import resolve
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.resonance import Resonance
from preisach_jax.fit import begun, in_reduced_basis
from preisach_jax.identify import evaluate

WANDER_HZ = 150.0


@pytest.fixture(scope="module")
def two_modes_behind_a_lag():
    """A step whose one mode is damped until it is about as late as two of them behind a lag."""
    tau_s, u = 0.0024, drive(9, ROWS)
    z = through(plays(lagging(u, tau_s)), ((45.0, 0.07, 0.6), (115.0, 0.04, 0.4)))
    z = z + np.random.default_rng([9, 1]).normal(0, 0.01, ROWS)
    with jax.enable_x64(True):
        record, whole, point = begun(pj.Record.from_arrays(np.arange(ROWS) / RATE, u, z), LEVELS)
        problem, point = in_reduced_basis(whole, point)
        *lags, resonance = resolve(("input_lag", "resonance"), {})
        step = added(Step(record, problem, whole, (*lags, resonance), (point,)), resonance)
        refused = [(each.trials[-1][0], False, "") for each in (added(step, lag) for lag in lags)]
        return replace(step, trials=(*step.trials, *refused))


def test_a_lag_and_a_mode_more_are_found_where_neither_helps_alone(x64, two_modes_behind_a_lag):
    step = two_modes_behind_a_lag
    found, more = with_larger_beside(step, 0.0)
    assert more
    found = in_best_forms(found)  # a lag beside one of two modes may have been taken in the other
    assert [named.name for named in found.named] == ["resonance", "input_lag"]
    values = found.now.values
    assert values["input_lag"]["tau_s"] == pytest.approx(0.0024, rel=0.03)
    modes = values["resonance"]
    assert [modes["f_hz"], modes["f_2_hz"]] == pytest.approx([45.0, 115.0], rel=0.01)
    assert modes["gain_2"] == pytest.approx(0.4 / 0.6, rel=0.1)
    assert found.now.validation_mean_square < 0.05 * step.now.validation_mean_square
    accepted = [trial.effect.name for trial, taken, _ in found.trials if taken]
    assert accepted[-1] == "input_lag"


def test_a_needless_mode_is_left_out(x64, two_modes_behind_a_lag):
    step = two_modes_behind_a_lag
    problem, now = step.problem, step.now
    less = now.chain.effect("resonance")
    more = replace(less, modes=2)
    values = {**now.values["resonance"], "f_2_hz": 300.0, "zeta_2": 0.4, "gain_2": 1e-3}
    chain = now.chain.with_effects((more,))
    point = evaluate(problem, chain, {"resonance": values}, now.strength, now)
    trial = replace(step.named[0].trial, effect=more, point=point)
    needless = replace(step, path=(step.path[0], point), named=(Named(trial, {}),))
    (left,) = without_needless_modes(needless).now.chain.effects
    assert isinstance(left, Resonance)
    assert left.modes == 1


class SixWaves(Drift):
    """A wander that is looked for with few waves only."""

    def variants(self, survey):
        return (replace(self.bound_to(survey), waves=6),)


def wandering(turn_s):
    """A step whose drift has six waves, beside a stage whose zero wanders in ten."""
    rng = np.random.default_rng(3)
    time, every = np.arange(ROWS) / WANDER_HZ, round(turn_s * WANDER_HZ)
    turns = np.arange(0, ROWS + every, every)
    u = np.interp(np.arange(ROWS), turns, 10.0 * (np.arange(len(turns)) % 2))
    u = u * (0.7 + 0.3 * np.cos(0.4 * time))
    phases = 2 * np.pi * rng.uniform(size=10)
    slow = (0.1 * np.cos(np.pi * k * time / time[-1] + p) for k, p in enumerate(phases, start=1))
    z = plays(u) + sum(slow) + rng.normal(0, 0.01, ROWS)
    record, problem, point = begun(pj.Record.from_arrays(time, u, z), LEVELS)
    return added(Step(record, problem, problem, (SixWaves(),), (point,)), SixWaves())


def test_a_wander_gets_the_waves_that_its_first_ones_leave(x64):
    step = wandering(0.24)
    larger = grown(step)
    assert larger is not None
    assert isinstance(drift := larger.now.chain.effect("drift"), Drift)
    assert drift.waves == 12
    assert larger.now.validation_mean_square < 0.9 * step.now.validation_mean_square
    assert [each.trial.effect for each in larger.named] == [drift]


def test_a_wander_gets_no_waves_as_fast_as_the_drive(x64):
    # Twelve waves in 20 s have periods down to 3.3 s; the drive comes back more seldom.
    assert grown(wandering(2.5)) is None
