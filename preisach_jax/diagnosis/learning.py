"""The training of a learned term, where no sparse form of what remains is offered.

A small network of the states at hand, other than time, is added to the model as if it were an
effect of one's own, and trained by the same path (`fit.training`), with the density refitted
beside it.  The blocks held out, which take no part in that, say whether it is offered, as they do
of a sparse form; chance is measured by the same training on remainders that are shifted round
parts of the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial.chebyshev import chebvander

from preisach_jax.diagnosis.evidence import evidence_between
from preisach_jax.diagnosis.form import Curve, LearnedTerm, State
from preisach_jax.diagnosis.freed import shifted
from preisach_jax.diagnosis.offer import Offer
from preisach_jax.diagnosis.terms import Along, columns_of, physics_of, states_of
from preisach_jax.effects.base import AddedEffect, Signals
from preisach_jax.effects.parameter import Parameter, coefficient
from preisach_jax.fit import SEARCH_ROWS, Fit, Progress, Schedule, in_silence, trained
from preisach_jax.identify import Point, Problem, evaluate, with_strength
from preisach_jax.record import Record

KINDS = ("position", "output", "rate", "path", "age")
"""Kinds of states that a learned term is made of, beside the columns."""

WIDTH, DEPTH = 16, 2
"""Numbers of a hidden layer, and how many of these there are."""

LEARNING_RATE, STEPS = 1e-2, 1_500

LEARNED_DRAWS = 8
"""Shifted remainders by which chance is measured, at most: each means a training."""

MOST_CURVES, LEAST_SHARE = 3, 0.1
"""States whose dependence is shown, and share of that of the first which a third one must have."""

DEGREE = 10
"""Degree of the functions of the input and of the output alone that are no part of a curve."""

ROUNDING = 1e-9
"""Part of the output's range below which nothing of it is left beside the input."""

POINTS, CURVE_ROWS = 25, 400
"""Points of a curve, and rows over which it is averaged."""


class LearnedColumn(AddedEffect):
    """A network of the states of a record, which stand in columns of their own."""

    name: ClassVar[str] = "learned term"

    net: eqx.nn.MLP
    states: tuple[str, ...] = eqx.field(static=True)

    def coefficients(self) -> tuple[Parameter, ...]:
        """The amount of the network's output."""
        return (coefficient("amount", "{z}"),)

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        """The network's output at each sample, `(time, 1)`."""
        states = jnp.stack([signals.aux[name] for name in self.states], axis=1)
        return jax.vmap(self.net)(states)[:, None]


def learned(
    fit: Fit, discretisation: float, seed: int, draws: int, progress: Progress = in_silence
) -> LearnedTerm:
    """The learned term of what a fit leaves, whatever the verdict on it.

    Arguments:
        discretisation: RMS of what the grid of the plane adds, in output units.
    """
    record = fit.record
    states = _states(record, fit.prediction)
    names = tuple(f"state {position}" for position in range(len(states)))
    given = {name: state.values for name, state in zip(names, states, strict=True)}
    problem = Problem.of(replace(record, aux={**record.aux, **given}), SEARCH_ROWS).reduced()
    own = fit.point
    point = evaluate(problem, own.chain, own.values, own.strength, own)
    point = with_strength(problem, point)
    net = eqx.nn.MLP(len(states), "scalar", WIDTH, DEPTH, jnp.tanh, key=jax.random.key(seed))
    column = LearnedColumn(net, names)
    after = _trained(problem, point, column, lambda text, done: progress(text, 0.5 * done))
    numbers = 1 + sum(int(np.size(each)) for each in jax.tree.leaves(eqx.filter(net, eqx.is_array)))
    evidence = evidence_between(problem, point.residual, after.residual)
    before, left = (
        float(np.sqrt(each.validation_mean_square)) * problem.unit for each in (point, after)
    )
    term = LearnedTerm(
        tuple(each.state for each in states), numbers, before, left, record.output_unit,
        evidence.numbers(), 0.0, 0, (), (), "",
    )  # fmt: skip
    offer = Offer(problem, point, evidence, before, left)
    if against := offer.against(discretisation):
        return replace(term, why_not=against)
    draws = min(draws, LEARNED_DRAWS)
    chance = 0.0
    generator = np.random.default_rng(seed)
    for draw in range(draws):
        progress("measuring what chance reaches", 0.5 + 0.5 * draw / draws)
        chance = max(chance, _by_chance(problem, point, column, generator))
    term = replace(term, chance=chance, draws=draws)
    if against := offer.against_chance(chance, draws):
        return replace(term, why_not=against)
    curves = _curves(_Freed.of(problem, after, states), states, seed)
    looked = dict.fromkeys(curve.physics for curve in curves)
    return replace(term, curves=curves, where_to_look=tuple(looked))


def _states(record: Record, output: np.ndarray) -> list[Along]:
    """The states that a learned term is made of, along all samples.

    The output follows the input so closely that its dependence could not be told from that on the
    input: of the output counts what does not go with the input.
    """
    every = np.arange(len(record))
    found = {each.kind: each for each in states_of(record, output, every) if each.kind in KINDS}
    if "position" in found and "output" in found:
        whole, basis = found["output"], chebvander(found["position"].values, DEGREE)
        rest = whole.values - basis @ np.linalg.lstsq(basis, whole.values, rcond=None)[0]
        size = float(np.abs(rest).max())
        if size > ROUNDING:
            own = State(
                f"{whole.state.name} beside what goes with the input", "h", whole.state.unit, 0.0,
                size * whole.state.scale,
            )  # fmt: skip
            found["output"] = Along(own, "output", rest / size)
        else:
            del found["output"]
    return [*found.values(), *columns_of(record, every, [])]


def _trained(
    problem: Problem, point: Point, column: LearnedColumn, progress: Progress = in_silence
) -> Point:
    """The model with a learned term beside its effects."""
    import optax

    chain = point.chain.with_effects((*point.chain.effects, column))
    values = {**point.values, column.name: {}}
    start = evaluate(problem, chain, values, point.strength, point)
    schedule = Schedule.of(optax.adam(LEARNING_RATE), STEPS)
    return trained(problem, start, [column.name], schedule, progress)[0]


def _by_chance(
    problem: Problem, point: Point, column: LearnedColumn, generator: np.random.Generator
) -> float:
    """Relative fall of the held-out mean square by a training on a shifted remainder."""
    moved = shifted(point.residual, problem.in_time, generator) - point.residual
    output = problem.record.output.copy()
    output[problem.rows] += moved * problem.unit
    other = replace(problem, record=replace(problem.record, output=output))
    plain = evaluate(other, point.chain, point.values, point.strength, point)
    after = _trained(other, plain, column)
    before, left = plain.validation_mean_square, after.validation_mean_square
    return 1 - left / before if before else 0.0


@dataclass(frozen=True, eq=False)
class _Freed:
    """A learned term without what it holds of the input alone and of the output alone.

    The density takes up most of that, so that it is in the term and out of the model by accident.

    Attributes:
        net: the network.
        amount: of its output, in output units.
        given: (row, state) standardised states of the measured rows.
        alone: places of the states whose functions are taken out.
        taken: (number,) coefficients of their Chebyshev polynomials, behind a constant.
    """

    net: eqx.nn.MLP
    amount: float
    given: np.ndarray
    alone: list[int]
    taken: np.ndarray

    @staticmethod
    def of(problem: Problem, point: Point, states: Sequence[Along]) -> _Freed:
        """The term of a model, along the rows of its record."""
        (column,) = [each for each in point.chain.effects if isinstance(each, LearnedColumn)]
        given = np.stack([problem.record.aux[name][problem.rows] for name in column.states], axis=1)
        alone = [k for k, each in enumerate(states) if each.kind in ("position", "output")]
        bare = _Freed(column.net, 1.0, given, alone, np.zeros(1 + DEGREE * len(alone)))
        raw = bare.at(given)
        amount = float(point.share_of(column.name) @ raw / (raw @ raw)) * problem.unit
        taken = np.linalg.lstsq(bare.alone_at(given), amount * raw, rcond=None)[0]
        return replace(bare, amount=amount, taken=taken)

    def alone_at(self, states: np.ndarray) -> np.ndarray:
        """(row, number) a constant, and polynomials of single states, of `(row, state)`."""
        parts = [np.ones((len(states), 1))]
        parts += [chebvander(states[:, k], DEGREE)[:, 1:] for k in self.alone]
        return np.concatenate(parts, axis=1)

    def at(self, states: np.ndarray) -> np.ndarray:
        """The term, in output units, at `(..., state)` standardised states."""
        flat = states.reshape(-1, states.shape[-1])
        found = self.amount * np.asarray(jax.vmap(self.net)(jnp.asarray(flat)))
        return (found - self.alone_at(flat) @ self.taken).reshape(states.shape[:-1])

    def shares(self, generator: np.random.Generator) -> np.ndarray:
        """(state,) share of the term's power that is lost where a state is drawn anew.

        Half the mean square of the change over the variance, which is the total index of Sobol'
        (M. J. W. Jansen, Comput. Phys. Commun. 117 (1999) 35-43).
        """
        whole = self.at(self.given)
        found = np.zeros(self.given.shape[1])
        for k in range(len(found)):
            drawn = self.given.copy()
            drawn[:, k] = generator.permutation(drawn[:, k])
            found[k] = np.mean((self.at(drawn) - whole) ** 2) / (2 * np.var(whole))
        return found

    def along(self, state: int, beside: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Standardised values of a state, ends of another, and means with neither of them, either.

        Returns:
            (point,), (2,) and (3, point): means over all rows, with the other state low, and high.
        """
        few = self.given[:: max(1, len(self.given) // CURVE_ROWS)]
        first, last = (float(np.quantile(self.given[:, state], q)) for q in (0.01, 0.99))
        places: np.ndarray = np.linspace(first, last, POINTS)
        ends = np.quantile(self.given[:, beside], (0.1, 0.9))
        rows = np.repeat(few[None], POINTS, axis=0)
        rows[:, :, state] = places[:, None]
        means = [self.at(rows).mean(axis=1)]
        for end in ends.tolist():
            rows[:, :, beside] = end
            means.append(self.at(rows).mean(axis=1))
        return places, ends, np.stack(means)


def _curves(freed: _Freed, states: Sequence[Along], seed: int) -> tuple[Curve, ...]:
    """How a learned term depends on the states that matter most."""
    shares = freed.shares(np.random.default_rng(seed))
    ranked: list[int] = np.argsort(-shares, kind="stable").tolist()[:MOST_CURVES]
    kept = [k for k in ranked if k in ranked[:2] or shares[k] >= LEAST_SHARE * shares[ranked[0]]]
    curves: list[Curve] = []
    for k in kept:
        beside = ranked[1] if k == ranked[0] else ranked[0]
        places, ends, (mean, low, high) = freed.along(k, beside)
        state, other = states[k].state, states[beside].state
        first, last = (other.centre + other.scale * ends).tolist()
        position = state.centre + state.scale * places
        together = bool(shares[beside] >= LEAST_SHARE * shares[k])
        physics = physics_of(states[k].kind, *[states[beside].kind] * together)
        curves.append(
            Curve(
                state, float(shares[k]), position, mean, other, first, last, low, high, physics
            )
        )  # fmt: skip
    return tuple(curves)
