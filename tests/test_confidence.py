"""Intervals cover the truth as often as they say, and are wider where noise is correlated."""

from dataclasses import replace

import numpy as np
import pytest
import test_identify
from scipy import signal
from test_identify import LEVELS, simulated

from preisach_jax.effects.ageing import Ageing
from preisach_jax.effects.base import AddedEffect
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.parameter import Parameter
from preisach_jax.fit import at_levels
from preisach_jax.identify import Problem, evaluate, refine, with_all_rows
from preisach_jax.identify.confidence import (
    OF_THE_LAW,
    differs_from_nothing,
    estimates,
    with_model_error,
)

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


def clean(effects, values, added):
    """A record of the model itself without noise, and its chain."""
    record, chain = simulated(effects, values, added, 0.0, COUNT)
    return record, record.output, chain


def identified(record, output, chain, values):
    problem = Problem.of(replace(record, output=output))
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
        (Slope(), "per_record", 0.5, 0.0, 0.85),
        # Neighbours correlated by 0.8 are remembered for longer than a block of four samples.
        (Slope(), "per_record", 0.5, 0.8, 0.7),
        (InputLag(), "tau_s", 0.05, 0.0, 0.85),
    ],
)
def test_intervals_cover_the_truth(x64, effect, name, truth, colour, least):
    values = {effect.name: {} if isinstance(effect, Slope) else {name: truth}}
    record, output, chain = clean((effect,), values, (truth,) if isinstance(effect, Slope) else ())
    found = [
        identified(record, output + noise_of(seed, colour), chain, values)[2][effect.name][name]
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
    record, output, chain = clean(effects, truth, ())
    problem, point, found = identified(record, output + 5 * noise_of(1), chain, truth)
    wider = with_model_error(found, point, at_levels(problem, point, LEVELS - 2))
    for effect, parameter in point.parameters:
        for each in (found, wider):
            own = each[effect][parameter.name]
            assert parameter.low <= own.low <= own.value <= own.high <= parameter.high
            assert own.low < own.high
            assert own.value == point.values[effect][parameter.name]
    assert found["creep"]["c_1"].low == 0.0


# --- whether an effect is there at all ---


def certain(effect, start, truth, added, seeds=SEEDS):
    """Share of records in which an effect is surely there, and in which one interval says so."""
    record, output, chain = clean((effect,), {effect.name: truth}, added)
    sure, alone = [], []
    for seed in range(seeds):
        noisy = output + noise_of(seed)
        problem, point, found = identified(record, noisy, chain, {effect.name: start})
        sure.append(any(differs_from_nothing(problem, point, effect.name)))
        amounts = [found[effect.name][name] for name in found[effect.name] if name in AMOUNTS]
        alone.append(any(each.low * each.high > 0 for each in amounts))
    return np.mean(sure), np.mean(alone)


AMOUNTS = ("per_record", "c_1", "c_2", "amplitude", "loss")


@pytest.mark.parametrize(
    ("effect", "start", "truth", "added"),
    [
        (Slope(), {}, {}, (-0.05,)),
        (Ageing(horizon_s=SECONDS), {"loss": 0.01, "tau_s": 2.0}, {"loss": 0.02, "tau_s": 2.0}, ()),
    ],
)
def test_an_effect_is_surely_there_if_it_stands_out_of_the_noise(x64, effect, start, truth, added):
    assert certain(effect, start, truth, added, seeds=5)[0] == 1.0


@pytest.mark.parametrize(
    ("effect", "start", "most"),
    [
        (Slope(), {}, 0.15),
        # Two amounts, each with its own interval, and both together.
        (Creep(tau_s=(0.4, 0.6)), {"c_1": 0.01, "c_2": 0.01}, 0.2),
    ],
)
def test_an_effect_that_is_absent_is_seldom_surely_there(x64, effect, start, most):
    absent = dict.fromkeys(start, 0.0)
    added = (0.0,) if isinstance(effect, Slope) else ()
    assert certain(effect, start, absent, added)[0] <= most


def test_elements_that_share_one_tail_are_sure_together(x64):
    twins = {"c_1": 0.01, "c_2": 0.01}
    sure, alone = certain(Creep(tau_s=(0.45, 0.55)), twins, twins, (), seeds=12)
    assert sure == 1.0
    assert alone < 0.9


def test_an_effect_without_amounts_is_there_once_it_is_in_the_model(x64):
    record, output, chain = clean((InputLag(),), {"input_lag": {"tau_s": 0.05}}, ())
    problem, point, _ = identified(record, output, chain, {"input_lag": {"tau_s": 0.05}})
    assert all(differs_from_nothing(problem, point, "input_lag"))


def test_intervals_grow_by_what_another_grid_tells_of_this_one():
    lag = InputLag()
    record, output, chain = clean(
        (lag, Slope()), {"input_lag": {"tau_s": 0.04}, "slope": {}}, [0.3]
    )
    values = {"input_lag": {"tau_s": 0.05}, "slope": {}}
    problem, point, found = identified(record, output + noise_of(1), chain, values)
    coarser = refine(problem, with_all_rows(at_levels(problem, point, LEVELS - 2)))
    wider = with_model_error(found, point, coarser)
    before, after = found["input_lag"]["tau_s"], wider["input_lag"]["tau_s"]
    ratio = coarser.values["input_lag"]["tau_s"] / point.values["input_lag"]["tau_s"]
    assert ratio != pytest.approx(1.0, abs=1e-4)
    assert after.value == before.value
    # An error that falls with the cell is so many times the change between the planes.
    times = (LEVELS - 2) / 2
    # The time constant is searched by its logarithm.
    for ends in ("low", "high"):
        was, now = (abs(np.log(getattr(own, ends) / own.value)) for own in (before, after))
        assert now == pytest.approx(OF_THE_LAW * np.hypot(was, times * np.log(ratio)), rel=1e-9)
    change = abs(coarser.coefficients().added[0] - point.coefficients().added[0])
    before, after = found["slope"]["per_record"], wider["slope"]["per_record"]
    assert change > 1e-4
    for ends in ("low", "high"):
        was, now = (abs(getattr(own, ends) - own.value) for own in (before, after))
        assert now == pytest.approx(OF_THE_LAW * np.hypot(was, times * change), rel=1e-9)
    # A form of fewer numbers was fitted to all rows.
    fewer = {"input_lag": found["input_lag"], "slope": {}}
    assert with_model_error(fewer, point, coarser) == {"input_lag": wider["input_lag"], "slope": {}}
