"""Limits of what was not found: closed forms, coverage on records of known content, and texts."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from preisach_jax.chain import Chain, Coefficients, response, signals_of
from preisach_jax.diagnosis.limits import Limit, limits
from preisach_jax.effects.base import AddedEffect, Effect, InputEffect, WeightEffect
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.input_quantisation import InputQuantisation
from preisach_jax.effects.leakage import Leakage
from preisach_jax.effects.output_lag import OutputLag
from preisach_jax.effects.output_quantisation import OutputQuantisation
from preisach_jax.effects.parameter import Parameter, parameter
from preisach_jax.effects.slew_limit import SlewLimit
from preisach_jax.identify import ALL, Point, Problem, evaluate, with_all_rows
from preisach_jax.identify.regression import normal_equations, penalties
from preisach_jax.identify.signature import Projection, prospects
from preisach_jax.operator.plane import Plane
from preisach_jax.record import Record

LEVELS, COUNT, STEP = 7, 1500, 0.01
TRIALS = 20
UNITS = {"input": "V", "output": "um"}


def excitation():
    """Ramps at two speeds between random levels, with a rest after every fourth."""
    rng = np.random.default_rng(11)
    turns, corners = [0.0], [0.0]
    while corners[-1] < COUNT * STEP:
        level = 10.0 * rng.uniform() if len(turns) > 3 else (10.0, 0.0, 10.0)[len(turns) - 1]
        speed = (15.0, 60.0)[len(turns) % 2]
        corners.append(corners[-1] + max(abs(level - turns[-1]) / speed, STEP))
        turns.append(level)
        if len(turns) % 4 == 0:
            corners.append(corners[-1] + 0.5)
            turns.append(level)
    time = np.arange(COUNT) * STEP
    return time, np.interp(time, corners, turns)


TIME, INPUT = excitation()
PLANE = Plane(LEVELS, float(INPUT.min()), float(INPUT.max()))


def hidden(effects=(), values=None, added=(), noise=0.01, seed=0, driven=INPUT):
    """A record of a model with the plane of the fit, so that all else is noise.

    What drives it may be another course than the recorded one.
    """
    chain = Chain(PLANE, tuple(effects))
    i, j = np.tril_indices(LEVELS)
    weights = 0.5 + 0.2 * i + 0.1 * j + np.where(i == j, 1.0, 0.0)
    every = np.zeros(len(chain.coefficients))
    every[: len(added)] = added
    blank = Record.from_arrays(TIME, driven, np.zeros(COUNT), initial_memory="low")
    coefficients = Coefficients(weights, np.zeros(len(i)), 2.0, every)
    output = np.asarray(response(chain, values or {}, signals_of(blank), coefficients))
    output = output + noise * np.random.default_rng(seed).normal(size=COUNT)
    return Record.from_arrays(TIME, INPUT, output, units=UNITS, initial_memory="low")


def plain_point(record, strength=1e-8):
    problem = Problem.of(record)
    return problem, evaluate(problem, Chain(PLANE), {}, strength)


# --- the projection ---


@pytest.mark.parametrize("seed", range(4))
def test_size_and_deviation_are_those_of_a_regression(x64, seed):
    """On a random matrix, the size is the last coefficient of an ordinary least squares fit."""
    rng = np.random.default_rng(seed)
    problem, real = plain_point(hidden())
    cells = 6
    matrix = rng.normal(size=(COUNT, cells + 1))
    matrix[:, cells] = 1.0
    target = matrix @ np.array([1.0, 2.0, 0.5, -3.0, 1.5, 1.0, 0.3]) + 0.1 * rng.normal(size=COUNT)
    nonnegative = np.arange(cells + 1) < cells
    equations = normal_equations(matrix, target, problem.fold, nonnegative, penalties(3, ()))
    columns = replace(
        real.columns,
        matrix=matrix,
        cells=cells,
        groups=(),
        start=np.zeros(cells),
        first_run=np.zeros(6, dtype=bool),
    )
    chain = Chain(Plane(3, 0.0, 10.0))
    point = with_all_rows(
        Point(chain, {}, 1e-14, ALL, 1.0, 0.0, target, matrix, columns, equations, np.empty(0), 0.0)
    )
    assert (point.solution[:cells] > 0).tolist() == [True, True, True, False, True, True]
    free = matrix[:, np.append(point.solution[:cells] > 0, True)]
    signature = matrix[:, 0] + 0.3 * rng.normal(size=COUNT)
    seen = Projection(problem, point).see(signature, {"tau_s": 1.0})

    whole = np.concatenate([free, signature[:, None]], axis=1)
    size = np.linalg.lstsq(whole, target, rcond=None)[0][-1]
    assert seen.size == pytest.approx(size, rel=1e-6)
    left = signature - free @ np.linalg.lstsq(free, signature, rcond=None)[0]
    residual = target - free @ np.linalg.lstsq(free, target, rcond=None)[0]
    scores = [
        np.sum((left * residual)[problem.block == block]) for block in np.unique(problem.block)
    ]
    count = len(scores)
    deviation = np.sqrt(np.sum(np.square(scores)) * count / (count - 1)) / (left @ left)
    assert seen.deviation == pytest.approx(deviation, rel=1e-6)
    # White noise: what ordinary least squares says of its coefficient.
    assert seen.deviation == pytest.approx(residual.std() / np.linalg.norm(left), rel=0.35)
    assert seen.absorbed == pytest.approx(1 - left @ left / (signature @ signature), abs=1e-9)
    assert seen.rms == pytest.approx(np.sqrt(np.mean(signature**2)))
    assert seen.values == {"tau_s": 1.0}


@pytest.mark.parametrize("part", ["weights", "nothing", "infinite"])
def test_what_the_model_takes_up_or_is_no_number_is_not_seen(x64, part):
    problem, point = plain_point(hidden())
    whole = with_all_rows(point)
    signature = {
        "weights": whole.matrix[:, :3].sum(axis=1) + 0.2,
        "nothing": np.zeros(len(whole.matrix)),
        "infinite": np.full(len(whole.matrix), np.inf),
    }[part]
    seen = Projection(problem, whole).see(signature, {})
    assert np.isnan(seen.size)
    assert seen.deviation == np.inf
    assert seen.absorbed == 1.0


# --- coverage ---


def limit_of(record, effect) -> Limit:
    problem, point = plain_point(record)
    (found,) = limits(problem, point, [effect])
    return found


def with_small(name, size, seed):
    """A record that hides an effect of a given size, in the unit of its limit."""
    if name == "drift":
        effect = Drift(horizon_s=float(TIME[-1]))
        return hidden((effect,), {"drift": {"tau_s": 8.0}}, (size,), seed=seed)
    if name == "creep":
        effect = Creep(tau_s=tuple(np.logspace(-0.7, 1.0, 5).tolist()))
        per_element = size * (1.7 / 4)
        gains = {f"c_{i}": per_element for i in range(1, 6)}
        return hidden((effect,), {"creep": gains}, seed=seed)
    return hidden((OutputLag(),), {"output_lag": {"tau_s": size}}, seed=seed)


def detectable(name):
    """What white noise lets be seen: 1.96 deviations of ordinary least squares, all else free."""
    problem, point = plain_point(hidden())
    free = point.matrix
    size = 1e-3
    moved = with_small(name, size, 0).output - hidden().output
    signature = moved[problem.rows] / size
    left = signature - free @ np.linalg.lstsq(free, signature, rcond=None)[0]
    return 1.96 * 0.01 / np.linalg.norm(left)


EFFECTS: dict[str, Effect] = {"drift": Drift(), "creep": Creep(), "output_lag": OutputLag()}
QUANTITIES = {
    "drift": ("amplitude", "um"),
    "creep": ("gain_per_decade", "1"),
    "output_lag": ("tau_s", "s"),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_the_limit_lies_above_what_is_hidden(x64, name):
    size = detectable(name)
    below = 0
    for seed in range(TRIALS):
        found = limit_of(with_small(name, size, seed), EFFECTS[name])
        assert (found.effect, found.quantity, found.unit) == (name, *QUANTITIES[name])
        assert found.value is not None
        assert not found.above
        below += found.value >= size
    assert below >= 0.85 * TRIALS


@pytest.mark.parametrize("name", EFFECTS)
def test_the_limit_is_near_what_can_be_seen(x64, name):
    size = detectable(name)
    found = [limit_of(hidden(seed=seed), EFFECTS[name]).value for seed in range(5)]
    assert all(value is not None and 0 < value < 10 * size for value in found)


# --- what cannot be seen, and what fails ---


class Column(AddedEffect):
    """Adds one column that is made of the record."""

    def coefficients(self):
        return (Parameter("gain", "{z}/{u}", -jnp.inf, jnp.inf),)


class Shifted(Column):
    name = "shifted"

    def columns(self, signals):
        return jnp.full((len(signals.time), 1), 3.0)


class Linear(Column):
    """What the cells on the diagonal make of the input already."""

    name = "linear"

    def columns(self, signals):
        return signals.input[:, None]


class Noise(Column):
    name = "chance"

    def columns(self, signals):
        return jnp.asarray(np.random.default_rng(5).normal(size=(len(signals.time), 1)))


@pytest.mark.parametrize("effect", [Shifted(), Linear()])
def test_what_the_density_takes_up_wholly_has_no_limit(x64, effect):
    found = limit_of(hidden(), effect)
    assert found.value is None
    assert found.rms is None
    assert found.absorbed == pytest.approx(1.0, abs=1e-6)
    assert found.unit == "um/V"
    assert found.text("um").startswith("undetectable in this record: 100 % of its effect could")


def test_what_nothing_takes_up_is_limited_by_the_noise(x64):
    found = limit_of(hidden(), Noise())
    assert found.value is not None
    assert found.rms is not None
    # Two-sided: one deviation of the estimate is 0.01 / sqrt(1500), and it lies within a few.
    assert 1.5 < found.value / (0.01 / np.sqrt(COUNT)) < 6
    assert found.rms == pytest.approx(found.value, rel=0.1)
    assert found.absorbed < 0.05


def test_the_limit_of_a_leakage_is_a_time_that_it_exceeds_wherever_the_record_begins(x64):
    """One that begins at the top is shifted by all its height, which the offset takes up."""
    risen = hidden()
    fallen = Record.from_arrays(TIME, 10 - INPUT, -risen.output, units=UNITS, initial_memory="high")
    for record in (risen, fallen):
        problem, point = plain_point(record)
        (found,) = limits(problem, point, [Leakage()])
        assert found.above
        assert found.value is not None
        assert found.value > 1.0


class Raising(InputEffect):
    name = "raising"

    a: float = parameter("1", 0.0, 1.0, start=(0.0,))

    def apply(self, signal, time):
        raise KeyError("my table")


class NotANumber(WeightEffect):
    name = "not_a_number"

    a: float = parameter("1", 0.0, 1.0, start=(0.0,))

    def factor(self, signals):
        return 1.0 - self.a / (signals.time - signals.time)


class WrongShape(Column):
    name = "wrong_shape"

    def columns(self, signals):
        return signals.time


class Unfinished(InputEffect):
    name = "unfinished"


def test_an_effect_that_fails_does_not_stop_the_others(x64):
    problem, point = plain_point(hidden())
    alone = limits(problem, point, [Drift(), OutputLag()])
    broken = (Raising(), WrongShape(), Unfinished())
    found = limits(problem, point, [broken[0], Drift(), *broken[1:], OutputLag()])
    assert found == alone
    assert [limit.effect for limit in found] == ["drift", "output_lag"]


def test_a_failure_of_a_built_in_effect_is_not_swallowed(x64, monkeypatch):
    problem, point = plain_point(hidden())

    def failing(self, survey):
        raise KeyError("its table")

    monkeypatch.setattr(Drift, "bound_to", failing)
    with pytest.raises(KeyError, match="its table"):
        limits(problem, point, [Drift()])


def test_an_effect_that_gives_no_numbers_has_no_limit(x64):
    found = limit_of(hidden(), NotANumber())
    assert found.value is None


class Warming(Column):
    name = "warming"

    def columns(self, signals):
        return -jnp.expm1(-signals.time[:, None] / 6.0)


def test_an_effect_of_the_model_is_part_of_what_takes_up(x64):
    """Beside a drift of one time constant, another one is harder to see."""
    record = hidden()
    problem, point = plain_point(record)
    drift = Drift().bound_to(problem.survey)
    chain = Chain(PLANE, (drift,))
    with_drift = evaluate(problem, chain, {"drift": {"tau_s": 8.0}}, 1e-8)

    (alone,) = limits(problem, point, [Warming()])
    (beside,) = limits(problem, with_drift, [Warming()])
    assert alone.value is not None
    assert beside.value is not None
    assert beside.absorbed > alone.absorbed
    assert beside.value > 2 * alone.value


# --- sizes, and the side on which they lie ---


def test_the_limit_of_a_slew_is_the_speed_it_surely_exceeds(x64):
    found = limit_of(hidden(), SlewLimit())
    assert found.above
    assert found.unit == "V/s"
    assert found.value is not None
    # The fastest ramps have 60 V/s: a slower drive would be seen at once.
    assert 30.0 < found.value <= 60.0
    assert found.text("um").startswith("slew above ")


def test_the_limit_of_a_lag_is_a_time_it_surely_falls_short_of(x64):
    found = limit_of(hidden(), InputLag())
    assert not found.above
    assert found.quantity == "tau_s"
    assert found.value is not None
    assert 0.0 < found.value < STEP


@pytest.mark.parametrize("quantum", [0.0, 0.02, 0.05, 0.1])
def test_the_limit_of_a_drives_steps_is_what_would_make_the_whole_residual(x64, quantum):
    driven = np.round(INPUT / quantum) * quantum if quantum else INPUT
    record = hidden(driven=driven)
    found = limit_of(record, InputQuantisation())
    whole = float(np.std(plain_point(record)[1].residual)) * np.ptp(record.output)
    assert found.value is not None
    assert quantum < found.value < max(1.5 * quantum, 0.02)
    # What the density takes up of it does not show in the residual.
    assert whole < found.rms * np.sqrt(1 - found.absorbed) < 1.15 * whole
    assert found.text("um").startswith("step below ")


@pytest.mark.parametrize("lattice", [0.01, 0.02, 0.1])
def test_a_command_recorded_on_a_round_lattice_has_a_limit_of_its_drives_steps_all_the_same(
    x64, lattice
):
    rounded = replace(hidden(), input=np.round(INPUT / lattice) * lattice)
    found = limit_of(rounded, InputQuantisation())
    assert found.value is not None
    assert lattice / 10 < found.value < max(4 * lattice, 0.05)


def test_steps_that_are_not_there_are_undetectable(x64):
    found = limit_of(hidden(), OutputQuantisation())
    assert found.value is None or found.value < 1e-4


def test_the_limit_of_steps_that_the_readings_show_is_their_step(x64):
    smooth = hidden()
    found = limit_of(
        replace(smooth, output=np.round(smooth.output / 0.25) * 0.25), OutputQuantisation()
    )
    assert found.value == pytest.approx(0.25)
    assert found.rms == pytest.approx(0.25 / np.sqrt(12), rel=0.3)
    assert found.text("um").startswith("step of 250 nm, as the record itself shows (")


@pytest.mark.parametrize(
    ("limit", "text"),
    [
        (
            Limit("input_lag", "tau_s", 3.1e-6, "s", False, 1.1e-3, 0.39),
            "tau below 3.1 µs (1.1 nm RMS of the output)",
        ),
        (
            Limit("resonance", "f_hz", 431.0, "Hz", True, 0.02, 0.1),
            "f above 430 Hz (20 nm RMS of the output)",
        ),
        (
            Limit("slew_limit", "slew", 470.0, "V/s", True, 0.58, 0.1, poorly_bounded=True),
            "poorly bounded: slew above 470 V/s (580 nm RMS of the output), more than the whole "
            "error",
        ),
        (
            Limit("creep", "gain_per_decade", 0.0012, "1", False, 0.05, 0.2),
            "gain per decade below 0.12 % (50 nm RMS of the output)",
        ),
        (
            Limit("moving", "a", None, "V/um", False, None, 0.9999),
            "undetectable in this record: 100 % of its effect could hide in the density",
        ),
    ],
)
def test_limits_in_words(limit, text):
    assert limit.text("um") == text


# --- screening ---


def promise_of(record, effect):
    problem, point = plain_point(record)
    projection = Projection(problem, point)
    bound = effect.bound_to(problem.survey_of(point))
    return max(each.explained for each in prospects(problem, point, projection, [bound]))


@pytest.mark.parametrize("seed", range(3))
def test_the_share_explained_is_that_of_a_regression(x64, seed):
    """On the rows that identify, beside the weights that are not zero."""
    rng = np.random.default_rng(seed)
    problem, point = plain_point(hidden(noise=0.05, seed=seed), strength=1e-12)
    rows = np.isin(problem.fold, point.folds)
    signatures = rng.normal(size=(COUNT, 3)) + point.matrix[:, :3]
    free = point.matrix[:, ~point.equations.nonnegative | (point.solution > 0)][rows]
    target = point.target[rows]

    def power(matrix):
        return np.sum((target - matrix @ np.linalg.lstsq(matrix, target, rcond=None)[0]) ** 2)

    expected = 1 - power(np.concatenate([free, signatures[rows]], axis=1)) / power(free)
    free_signs = np.zeros(3, dtype=bool)
    projection = Projection(problem, point)
    promise, _ = projection.promised(signatures * [1.0, 1e-9, 1e6], free_signs)
    assert promise.explained == pytest.approx(expected, rel=1e-3)
    nothing = np.stack([np.zeros(COUNT), np.full(COUNT, np.nan), point.matrix[:, -1]], axis=1)
    promise, _ = projection.promised(nothing, free_signs)
    assert promise.explained == pytest.approx(0.0, abs=1e-9)


def test_what_cannot_change_its_sign_promises_nothing_with_the_other(x64):
    problem, point = plain_point(hidden(noise=0.05))
    projection = Projection(problem, point)
    signature = projection.left(point.residual + 1e-4 * np.sin(np.arange(COUNT)))[:, None]
    only_positive = np.ones(1, dtype=bool)
    right, as_it_is = projection.promised(signature, only_positive)
    wrong, _ = projection.promised(-signature, only_positive)
    assert right.explained > 0.9
    assert as_it_is > 0.9
    assert wrong.explained == pytest.approx(0.0, abs=1e-12)


def test_an_amount_at_zero_takes_up_nothing_by_a_sign_that_it_cannot_have(x64):
    problem, point = plain_point(hidden(noise=0.05))
    creep = Creep().bound_to(problem.survey_of(point))
    start = {p.name: p.start[0] for p in creep.parameters()}
    none = {name: 0.0 if name.startswith("c_") else v for name, v in start.items()}
    chain = point.chain.with_effects((creep,))
    without, weak = (
        evaluate(problem, chain, {"creep": each}, point.strength)
        for each in (none, {**none, "c_3": 0.02})
    )
    change = (weak.residual - without.residual)[:, None]

    def share_left(at, any_sign):
        left = Projection(problem, at, any_sign=any_sign).left(change)
        return np.sum(left**2) / np.sum(change**2)

    assert share_left(without, any_sign=True) < 0.2 * share_left(without, any_sign=False)
    one_amount = share_left(weak, any_sign=False)
    assert share_left(weak, any_sign=True) < one_amount < share_left(without, any_sign=False)


def test_the_gain_promised_on_held_out_rows_is_that_of_a_regression(x64):
    rng = np.random.default_rng(3)
    problem, point = plain_point(hidden(noise=0.05, seed=3), strength=1e-12)
    rows = np.isin(problem.fold, point.folds)
    signature = rng.normal(size=(COUNT, 1)) + 3 * point.residual[:, None]
    free = point.matrix[:, ~point.equations.nonnegative | (point.solution > 0)]
    whole = np.concatenate([free, signature], axis=1)

    def held_out(matrix):
        solution = np.linalg.lstsq(matrix[rows], point.target[rows], rcond=None)[0]
        return np.mean((point.target - matrix @ solution)[~rows] ** 2)

    promise, _ = Projection(problem, point).promised(signature, np.zeros(1, dtype=bool))
    assert promise.held_out == pytest.approx(1 - held_out(whole) / held_out(free), rel=1e-2)


HIDDEN_EFFECTS = [
    (InputLag(), {"input_lag": {"tau_s": 0.02}}, ()),
    (OutputLag(), {"output_lag": {"tau_s": 0.02}}, ()),
    (Creep((0.1, 1.0)), {"creep": {"c_1": 0.05, "c_2": 0.05}}, ()),
    (Drift(horizon_s=15.0), {"drift": {"tau_s": 5.0}}, (1.0,)),
]


@pytest.mark.parametrize("place", range(len(HIDDEN_EFFECTS)))
def test_what_is_hidden_promises_more_than_what_is_not(x64, place):
    effect, values, added = HIDDEN_EFFECTS[place]
    record = hidden([effect], values, added, noise=0.01, seed=place)
    assert promise_of(record, type(effect)()) > 0.5
    assert promise_of(hidden(noise=0.01, seed=place), type(effect)()) < 0.02
