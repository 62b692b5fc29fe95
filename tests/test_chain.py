"""The signal chain: two ways to its output agree, and derivatives are those of differences."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from exported import KINDS

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.chain.driven import drive, driven_path
from preisach_jax.chain.hysteresis import hysteresis_columns, hysteresis_output, stated_start
from preisach_jax.chain.matrix import regressors
from preisach_jax.chain.output import response, tangents
from preisach_jax.chain.signals import Drive, signals_of
from preisach_jax.effects import library
from preisach_jax.effects.base import Effect, InputEffect
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.fit.stepwise import base_point
from preisach_jax.identify.gauss_newton import linearise, starts_of
from preisach_jax.identify.problem import Problem, evaluate
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import hysteron_states
from preisach_jax.record.core import Record

PLANE = Plane(levels=5, low=0.0, high=12.0)
COUNT = 400
EFFECTS: dict[str, Effect] = {
    "creep": Creep(tau_s=(0.1, 1.0)),
    "input_lag": KINDS["input_lag"](),
    "delay": KINDS["delay"](),
    "drift": Drift(horizon_s=3.0),
    "ageing": KINDS["ageing"](horizon_s=3.0),
    "aux:load_N": KINDS["aux:COL"](column="load_N", unit="N"),
}
VALUES: dict[str, dict[str, float]] = {
    "creep": {"c_1": 0.1, "c_2": 0.07},
    "input_lag": {"tau_s": 0.06},
    "delay": {"delay_s": 0.043},
    "drift": {"tau_s": 1.7},
    "ageing": {"loss": 0.2, "tau_s": 2.0},
    "aux:load_N": {"tau_s": 0.1},
}


def record(memory="free", seed=0, jump=1.5):
    """A wandering input that starts in the middle of the range, at uneven times."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.005, 0.02, COUNT))
    path = np.clip(6.5 + np.cumsum(jump * rng.normal(size=COUNT)), 0.0, 12.0)
    aux = {"load_N": np.cumsum(rng.normal(size=COUNT))}
    return Record.from_arrays(time, path, np.zeros(COUNT), aux=aux, initial_memory=memory)


def setting(memory="free", **options):
    """A chain with all these effects, its signals, its regressors and random coefficients."""
    chain, signals = Chain(PLANE, tuple(EFFECTS.values())), signals_of(record(memory, **options))
    path = driven_path(chain, VALUES, signals)
    columns = regressors(chain, VALUES, signals, hysteresis_columns(chain, Drive(path), memory))
    solution = np.random.default_rng(1).uniform(0.2, 1.0, columns.matrix.shape[1])
    return chain, signals, columns, solution


@pytest.mark.parametrize("memory", ["free", "low", "demagnetised"])
def test_regressors_and_response_agree(x64, memory):
    chain, signals, columns, solution = setting(memory)
    coefficients = Coefficients.from_columns(columns, solution)
    got = response(chain, VALUES, signals, coefficients)
    assert np.ptp(got) > 1.0
    np.testing.assert_allclose(columns.matrix @ solution, got, rtol=0, atol=1e-11)


def test_a_demagnetised_start_is_on_below_the_line(x64):
    chain = Chain(PLANE)
    start = stated_start(chain, Drive(jnp.asarray([6.0])), "demagnetised")
    line = PLANE.alpha + PLANE.beta - 12.0
    unforced = (PLANE.alpha > 6.0) & (PLANE.beta < 6.0)
    expected = np.where(np.abs(line) < 1e-9, 0.5, line < 0)
    np.testing.assert_allclose(start[unforced], expected[unforced])
    assert len(set(start[unforced])) == 3
    # Saturated, it is that of the plane.
    rec, weights = record("high"), np.linspace(0.5, 1.0, PLANE.cells)
    signals = signals_of(rec)
    start = stated_start(chain, drive(chain, {}, signals), "high")
    own = Coefficients(weights, weights * start, 0.0, np.zeros(0))
    got = hysteresis_output(chain, {}, signals, own)
    expected = hysteron_states(PLANE, rec.input, "high") @ weights
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("hysteron", ["ramp", "relay"])
def test_hysterons_beyond_the_range_are_in_the_span(x64, hysteron):
    # After the first run, whole loops: what switches once cannot pass for what does so each time.
    loops = np.interp(np.arange(320), [0, 80, 160, 240, 319], [0, 12, 0, 12, 3])
    x = np.concatenate([record(seed=1, jump=0.4).input, loops])
    rec = Record.from_arrays(np.arange(len(x)) / 100, x, x)
    # Random weights and switches of hysterons whose thresholds lie beyond the range as well.
    plane = Plane(6, 0.0, 12.0)  # its cells have a width without rounding
    rng, reach = np.random.default_rng(1), 4 * plane.delta_x
    wide = Plane(plane.levels + 8, plane.low - reach, plane.high + reach)
    switches = rng.integers(0, 2, wide.cells).astype(float)
    states = hysteron_states(wide, x, switches, hysteron)
    target = np.asarray(states) @ rng.uniform(0.1, 1.0, wide.cells)
    chain, signals = Chain(plane, (), hysteron), signals_of(rec)
    course = Drive(signals.input)
    columns = regressors(chain, {}, signals, hysteresis_columns(chain, course, "free"))
    for saturated in ("low", "high"):
        assert not hysteresis_columns(chain, course, saturated).first_run.any()
    solution = np.linalg.lstsq(columns.matrix, target, rcond=None)[0]
    np.testing.assert_allclose(columns.matrix @ solution, target, rtol=0, atol=1e-8)
    # Without them, the course of the first run is not.
    inside = np.ones(columns.matrix.shape[1], dtype=bool)
    inside[columns.offset - columns.first_run.sum() : columns.offset] = False
    plain = columns.matrix[:, inside]
    left = target - plain @ np.linalg.lstsq(plain, target, rcond=None)[0]
    assert np.abs(left).max() > 0.05
    got = response(chain, {}, signals, Coefficients.from_columns(columns, solution))
    np.testing.assert_allclose(got, target, rtol=0, atol=1e-8)


def test_added_effects_do_not_pass_the_output_effects(x64):
    """Drift is added to what is recorded, so that creep does not follow it."""
    rec, names = record("low"), ("drift", "creep")
    chain = Chain(PLANE, tuple(EFFECTS[name] for name in names))
    nothing = np.zeros(PLANE.cells)
    own = Coefficients(nothing, nothing, 2.0, np.array([3.0, 0.0, 0.0]))
    got = response(chain, {name: VALUES[name] for name in names}, signals_of(rec), own)
    time = rec.time - rec.time[0]
    np.testing.assert_allclose(got, 2.0 + 3.0 * np.expm1(-time / 1.7) / np.expm1(-3.0 / 1.7))


def own(name, law):
    apply = {"apply": lambda self, signal, time: law(signal)}
    return type(name, (InputEffect,), {"name": name} | apply)()


def test_effects_of_one_place_act_in_their_order(x64):
    signals = signals_of(record())
    values: dict[str, dict[str, float]] = {"doubled": {}, "halved": {}}
    doubled, halved = (
        own("doubled", lambda x: jnp.minimum(2 * x, 10)),
        own("halved", lambda x: x / 2),
    )
    first = driven_path(Chain(PLANE, (doubled, halved)), values, signals)
    second = driven_path(Chain(PLANE, (halved, doubled)), values, signals)
    np.testing.assert_allclose(first, np.minimum(signals.input, 5.0))
    np.testing.assert_allclose(second, np.minimum(signals.input, 10.0))


def test_effects_of_one_name_and_without_a_place_are_refused():
    class Lost(Effect):
        name = "lost"

    with pytest.raises(ValueError, match="a name twice"):
        Chain(PLANE, (Creep(), Creep(tau_s=(1.0,))))
    with pytest.raises(ValueError, match="'lost' is a Lost: derive it from InputEffect"):
        Chain(PLANE, (Lost(),))


def test_tangents_against_finite_differences(x64):
    chain, signals, columns, solution = setting(jump=0.5)
    coefficients = Coefficients.from_columns(columns, solution)
    every = [(name, key) for name, own in VALUES.items() for key in own]
    got = tangents(chain, VALUES, signals, coefficients, every)
    assert got.shape == (COUNT, len(every))
    assert tangents(chain, VALUES, signals, coefficients, []).shape == (COUNT, 0)
    for column, (name, key) in zip(got.T, every, strict=True):
        step = 1e-6 * VALUES[name][key]

        def at(value, name=name, key=key):
            moved = {**VALUES, name: {**VALUES[name], key: value}}
            return np.asarray(response(chain, moved, signals, coefficients))

        middle = VALUES[name][key]
        expected = (at(middle + step) - at(middle - step)) / (2 * step)
        scale = np.abs(expected).max()
        assert scale > 1e-3
        # The operator has corners: a sample on the edge of a cell has two one-sided slopes.
        apart = np.abs(column - expected) > 1e-5 * scale
        assert apart.mean() < 0.01


OF_THE_RECORD = (
    "creep", "input_lag", "delay", "resonance", "slew_limit", "rate_dependence", "moving", "drift",
    "hum", "ageing", "output_nonlinearity", "viscosity",
)  # fmt: skip
"""Effects that hold numbers of a record, one of each kind of law."""


def test_another_record_of_the_same_size_compiles_nothing(x64, compilations):
    """Another range of the input, another scale of time, and a start that leaves more open."""

    def everything(record):
        point = base_point(problem := Problem.of(record), 5)
        for name in OF_THE_RECORD:
            bound = library()[name].bound_to(problem.survey_of(point))
            bound = replace(bound, waves=3) if isinstance(bound, Drift) else bound
            chain = point.chain.with_effects((bound,))
            values = {bound.name: starts_of(bound)[0]}
            trial = evaluate(problem, chain, values, point.strength, point)
            linearise(problem, trial, trial.parameters)

    time = np.arange(700) / 50.0
    one = 5 - 5 * np.cos(time * (1 + time / 20) + 1.5)
    other = 3 - 20 * np.cos(time * (1 + time / 15) + 2.0)
    assert compilations(lambda: everything(Record.from_arrays(time, one, one**1.1)))
    again = Record.from_arrays(7 * time, other, other + 0.01 * other**2)
    assert not compilations(lambda: everything(again))
