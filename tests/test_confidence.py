"""Intervals cover the truth as often as they say, and are wider where noise is correlated."""

from typing import Any

import numpy as np
import pytest
import world
from scipy import signal
from threadpoolctl import threadpool_limits

from preisach_jax.chain import Chain, Coefficients, response, signals_of
from preisach_jax.effects import parameter as declare
from preisach_jax.effects.ageing import Ageing
from preisach_jax.effects.base import AddedEffect, InputEffect
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
from preisach_jax.operator.plane import Plane
from preisach_jax.record import Record

SEEDS = 20
SECONDS, COUNT, LEVELS = 6.0, 400, 5
NOISE = 0.05
UNITS = {"input": "V", "output": "um"}


@pytest.fixture(autouse=True)
def one_thread():
    with threadpool_limits(1):
        yield


class Slope(AddedEffect):
    """A straight drift: one linear coefficient and nothing else."""

    name = "slope"

    def coefficients(self):
        return (Parameter("per_record", "{z}", -np.inf, np.inf),)

    def columns(self, signals):
        return signals.time[:, None] / SECONDS


def clean(effects, values, added, count=COUNT):
    """A record of the model itself without noise, and its chain."""
    time = np.arange(count) * SECONDS / count
    drive = world.excitation("rich", SECONDS, count / SECONDS, seed=1)
    chain = Chain(Plane(LEVELS, float(drive.min()), float(drive.max())), tuple(effects))
    i, j = np.tril_indices(LEVELS)
    weights = 0.5 + 0.2 * i + 0.1 * j + (i == j)
    rest = np.zeros(len(chain.coefficients) - len(added))  # at rest before the record
    coefficients = Coefficients(weights, np.zeros(len(i)), 2.0, np.append(added, rest))
    record = Record.from_arrays(time, drive, np.zeros(count), units=UNITS, initial_memory="low")
    output = np.asarray(response(chain, values, signals_of(record), coefficients))
    return record, output, chain


def identified(record, output, chain, values):
    noisy = Record.from_arrays(record.time, record.input, output, units=UNITS, initial_memory="low")
    problem = Problem.of(noisy)
    point = refine(problem, with_all_rows(evaluate(problem, chain, values, 1e-5)))
    return problem, point, estimates(problem, point)


def noise_of(seed, colour, count=COUNT):
    """Noise of one power, whatever the correlation of its neighbours."""
    white = np.random.default_rng(seed).normal(size=count + 200)
    blend = np.sqrt(1 - colour**2)
    return NOISE * np.asarray(signal.lfilter([blend], [1.0, -colour], white))[200:]


def over_seeds(effects, truth, added, colour=0.0) -> list[dict[str, Any]]:
    record, output, chain = clean(effects, truth, added)
    return [
        identified(record, output + noise_of(seed, colour), chain, truth)[2]
        for seed in range(SEEDS)
    ]


def coverage(found, effect, name, truth):
    inside = [each[effect][name].low <= truth <= each[effect][name].high for each in found]
    return float(np.mean(inside))


@pytest.mark.parametrize(("colour", "least"), [(0.0, 0.85), (0.8, 0.7)])
def test_intervals_of_a_coefficient_cover_the_truth(x64, colour, least):
    """Neighbours correlated by 0.8 are remembered for longer than a block of four samples."""
    found = over_seeds((Slope(),), {"slope": {}}, (0.5,), colour)
    assert least <= coverage(found, "slope", "per_record", 0.5) <= 1.0
    # Their width is the scatter from record to record, which nothing in the code knows.
    values = np.array([each["slope"]["per_record"].value for each in found])
    widths = [each["slope"]["per_record"].high - each["slope"]["per_record"].low for each in found]
    assert np.mean(widths) / 4 == pytest.approx(np.std(values), rel=0.35)
    assert np.mean(values) == pytest.approx(0.5, abs=3 * np.std(values) / np.sqrt(SEEDS) + 1e-3)


def test_intervals_of_an_input_lag_cover_the_truth(x64):
    found = over_seeds((InputLag(),), {"input_lag": {"tau_s": 0.05}}, ())
    assert coverage(found, "input_lag", "tau_s", 0.05) >= 0.85
    logs = np.log([each["input_lag"]["tau_s"].value for each in found])
    widths = [
        np.log(each["input_lag"]["tau_s"].high / each["input_lag"]["tau_s"].low) for each in found
    ]
    assert np.mean(widths) / 4 == pytest.approx(np.std(logs), rel=0.35)


def test_intervals_stay_inside_the_bounds_and_hold_their_value_on_any_grid(x64):
    truth = {"creep": {"c_1": 0.0, "c_2": 0.02}, "ageing": {"loss": 0.05, "tau_s": 2.0}}
    effects = (Creep(tau_s=(0.1, 1.0)), Ageing(horizon_s=SECONDS))
    record, output, chain = clean(effects, truth, ())
    problem, point, found = identified(record, output + 5 * noise_of(1, 0.0), chain, truth)
    wider = with_model_error(found, point, at_levels(problem, point, LEVELS - 2))
    for effect, parameter in point.parameters:
        for each in (found, wider):
            own = each[effect][parameter.name]
            assert parameter.low <= own.low <= own.value <= own.high <= parameter.high
            assert own.low < own.high
            assert own.value == point.values[effect][parameter.name]
    assert found["creep"]["c_1"].low == 0.0


def test_units_are_those_of_the_record(x64):
    class Mixed(InputEffect):
        name = "mixed"

        a: float = declare.parameter("{z}/{u}", 0.0, 1.0, start=(0.5,))

        def apply(self, signal, time):
            return signal * (1 - 0.01 * self.a)

    values = {"mixed": {"a": 0.5}, "slope": {}}
    record, output, chain = clean((Mixed(), Slope()), values, (0.1,))
    _, _, found = identified(record, output + noise_of(0, 0.0), chain, values)
    assert found["mixed"]["a"].unit == "um/V"
    assert found["slope"]["per_record"].unit == "um"


# --- whether an effect is there at all ---


def certain(effect, start, truth, added, seeds=SEEDS):
    """Share of records in which an effect is surely there, and in which one interval says so."""
    record, output, chain = clean((effect,), {effect.name: truth}, added)
    sure, alone = [], []
    for seed in range(seeds):
        noisy = output + noise_of(seed, 0.0)
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
    problem, point, found = identified(record, output + noise_of(1, 0.0), chain, values)
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
