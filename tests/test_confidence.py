"""Intervals cover the truth as often as they say, and are wider where noise is correlated."""

from dataclasses import replace

import numpy as np
import pytest
import test_identify
from scipy import signal
from test_identify import LEVELS, simulated

from preisach_jax import AddedEffect, Parameter
from preisach_jax.effects.ageing import Ageing
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.fit.stepwise import at_levels
from preisach_jax.identify.confidence import OF_THE_LAW, estimates, with_model_error
from preisach_jax.identify.gauss_newton import refine
from preisach_jax.identify.problem import Problem, evaluate, with_all_rows

SEEDS = 20
SECONDS, COUNT = 6.0, 400
NOISE = 0.05


one_thread = test_identify.one_thread


class Slope(AddedEffect):
    """A straight drift: one linear coefficient and nothing else."""

    name = "slope"

    def coefficients(self):
        return (Parameter("per_record", "{z}", -np.inf, np.inf),)

    def columns(self, signals):
        return signals.time[:, None] / SECONDS


def identified(record, chain, values, noise):
    problem = Problem.of(replace(record, output=record.output + noise))
    point = refine(problem, with_all_rows(evaluate(problem, chain, values, 1e-5)))
    return problem, point, estimates(problem, point)


def noise_of(seed, colour=0.0):
    """Noise of one power, whatever the correlation of its neighbours."""
    white = np.random.default_rng(seed).normal(size=COUNT + 200)
    blend = np.sqrt(1 - colour**2)
    return NOISE * np.asarray(signal.lfilter([blend], [1.0, -colour], white))[200:]


@pytest.mark.parametrize(
    ("effect", "name", "truth", "colour", "least"),
    [
        (Slope(), "per_record", 0.5, 0.0, 0.9),
        # Neighbours correlated by 0.8 are remembered for longer than a block of four samples.
        (Slope(), "per_record", 0.5, 0.8, 0.7),
        (InputLag(), "tau_s", 0.05, 0.0, 0.75),  # 87 of 100 seeds
    ],
)
def test_intervals_cover_the_truth(x64, effect, name, truth, colour, least):
    values = {effect.name: {} if isinstance(effect, Slope) else {name: truth}}
    added = (truth,) if isinstance(effect, Slope) else ()
    made = simulated((effect,), values, added, 0.0, COUNT)
    found = [
        identified(*made, values, noise_of(seed, colour))[2][effect.name][name]
        for seed in range(SEEDS)
    ]
    assert np.mean([each.low <= truth <= each.high for each in found]) >= least
    # Their width is the scatter from record to record, which nothing in the code knows.
    spread = np.array([(each.value, each.high, each.low) for each in found]) / truth
    spread = np.log(spread) if name == "tau_s" else spread
    assert np.mean(spread[:, 1] - spread[:, 2]) / 4 == pytest.approx(np.std(spread[:, 0]), rel=0.35)


def test_intervals_stay_inside_the_bounds_and_hold_their_value_on_any_grid(x64):
    truth = {"creep": {"c_1": 0.0, "c_2": 0.02}, "ageing": {"loss": 0.05, "tau_s": 2.0}}
    effects = (Creep(tau_s=(0.1, 1.0)), Ageing(horizon_s=SECONDS))
    made = simulated(effects, truth, (), 0.0, COUNT)
    problem, point, found = identified(*made, truth, 5 * noise_of(1))
    wider = with_model_error(found, point, at_levels(problem, point, LEVELS - 2))
    for effect, parameter in point.parameters:
        for each in (found, wider):
            own = each[effect][parameter.name]
            assert parameter.low <= own.low <= own.value <= own.high <= parameter.high
            assert own.low < own.high
            assert own.value == point.values[effect][parameter.name]
    assert found["creep"]["c_1"].low == 0.0


def test_intervals_grow_by_what_another_grid_tells_of_this_one():
    lag = InputLag()
    truth = {"input_lag": {"tau_s": 0.04}, "slope": {}}
    made = simulated((lag, Slope()), truth, [0.3], 0.0, COUNT)
    values = {"input_lag": {"tau_s": 0.05}, "slope": {}}
    problem, point, found = identified(*made, values, noise_of(1))
    coarser = refine(problem, with_all_rows(at_levels(problem, point, LEVELS - 2)))
    wider = with_model_error(found, point, coarser)
    ratio = coarser.values["input_lag"]["tau_s"] / point.values["input_lag"]["tau_s"]
    change = coarser.coefficients().added[0] - point.coefficients().added[0]
    times = (LEVELS - 2) / 2  # that change, where an error falls with the cell
    # The time constant is searched by its logarithm.
    for effect, name, scale, moved in (
        ("input_lag", "tau_s", np.log, np.log(ratio)),
        ("slope", "per_record", float, change),
    ):
        before, after = found[effect][name], wider[effect][name]
        assert abs(moved) > 1e-4
        assert after.value == before.value
        for ends in ("low", "high"):
            was, now = (scale(getattr(own, ends)) - scale(own.value) for own in (before, after))
            expected = OF_THE_LAW * np.hypot(was, times * moved)
            assert abs(now) == pytest.approx(expected, rel=1e-9)
    # A form of fewer numbers was fitted to all rows.
    fewer = {"input_lag": found["input_lag"], "slope": {}}
    assert with_model_error(fewer, point, coarser) == {"input_lag": wider["input_lag"], "slope": {}}
