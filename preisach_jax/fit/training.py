"""Effects that hold arrays, trained by an optimiser through the model."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.effects.arrays import is_floating
from preisach_jax.effects.base import Effect
from preisach_jax.errors import InputError, NotFiniteError, whole_number
from preisach_jax.fit.stepwise import Progress, in_silence
from preisach_jax.identify import IDENTIFICATION, Point, Problem, evaluate, refine, with_strength

if TYPE_CHECKING:
    from optax import GradientTransformation, GradientTransformationExtraArgs

    from preisach_jax.fit.gradient import Leaves, TakenSteps

TRAINING_STEPS = 2_000
"""TakenSteps of an optimiser, at most, if nothing else is asked for."""

STEPS_AT_ONCE = 25
"""TakenSteps from one solution for the linear coefficients to the next."""

PATIENCE = 10
"""Such rounds without a better model until the training ends."""

LEAST_FALL = 1e-3
"""Relative fall of the mean square by which a model is better."""

DIVERGED = 25.0
"""Times the mean square at the start at which a training has diverged."""

TRAINED, STOPPING = IDENTIFICATION[:-1], IDENTIFICATION[-1:]
"""Folds of the rows that identify: those by which arrays are trained, and the one that says which
step is the best.  The rows that are held out take no part in either."""


@dataclass(frozen=True)
class Training:
    """How the arrays of effects were trained.

    Attributes:
        effects: names of the effects.
        numbers: how many numbers their arrays hold.
        steps: steps that were taken.
        best_step: step whose arrays were kept; 0 where no step lowers the error.
        rms_before, rms_after: error on the identification rows that chose the step, before the
            first step and at the best one, in output units.
        ended: why it ended.
    """

    effects: tuple[str, ...]
    numbers: int
    steps: int
    best_step: int
    rms_before: float
    rms_after: float
    ended: str


@dataclass(frozen=True, eq=False)
class Schedule:
    """How effects are trained: by which optimiser, and for how many steps at most."""

    optimiser: GradientTransformationExtraArgs
    steps: int

    @staticmethod
    def of(optimiser: GradientTransformation, steps: int | None) -> Schedule:
        """A schedule from what a user gave."""
        import optax

        if not isinstance(optimiser, optax.GradientTransformation):
            raise InputError(
                f"optimiser is {optimiser!r:.80}: give one of optax, such as optax.adam(1e-2)"
            )
        count = TRAINING_STEPS if steps is None else steps
        count = whole_number("training_steps is", count, least=1)
        return Schedule(optax.with_extra_args_support(optimiser), count)


def in_double(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Some effects whose arrays are in double precision, if any of them has arrays to train."""
    from preisach_jax.fit.gradient import leaves_of

    if not leaves_of(effects):
        names = ", ".join(effect.name for effect in effects) or "none"
        raise InputError(
            f"an optimiser is given, but no effect (effects: {names}) holds a floating array "
            "that it can train; pass one that does, such as an equinox.nn.MLP, or no optimiser"
        )

    def cast(leaf: Any) -> Any:
        return jnp.asarray(leaf, float) if is_floating(leaf) else leaf

    return tuple(jax.tree.map(cast, effect) for effect in effects)


@dataclass(frozen=True, eq=False)
class _Best:
    """The best model so far.

    Attributes:
        step: how many steps it took.
        point: the model.
        mean_square: on the fold that chooses, in squared output ranges.
    """

    step: int
    point: Point
    mean_square: float


def trained(
    problem: Problem,
    point: Point,
    names: Collection[str],
    schedule: Schedule,
    progress: Progress = in_silence,
) -> tuple[Point, Training]:
    """The model whose effects have trained arrays, its other numbers refitted with them.

    Returns:
        The model, solved on all rows that identify, and how it was trained.  Where the training
        fails after it has found a better model than that of the start, it is that model.
    """
    from preisach_jax.fit.gradient import VariableProjection, leaves_of, shared, steps_taken

    leaves = leaves_of(tuple(each for each in point.chain.effects if each.name in names))
    now = evaluate(problem, point.chain, point.values, point.strength, point, TRAINED)
    first = best = _Best(0, now, _mean_square(problem, now))
    state = schedule.optimiser.init(leaves)
    optimiser = shared(schedule.optimiser, leaves)
    at_once = min(STEPS_AT_ONCE, schedule.steps)
    rounds = -(-schedule.steps // at_once)
    taken, ended = 0, f"all {rounds * at_once} steps were taken"
    for position in range(rounds):
        progress(f"training {', '.join(leaves)}, step {taken}", position / rounds)
        projection = VariableProjection.of(problem, now, tuple(leaves))
        result = steps_taken(projection, leaves, state, optimiser, at_once)
        failure = _failure(result, leaves, taken)
        if not failure:
            leaves, state, taken = result.leaves, result.state, taken + at_once
            moved = _moved(problem, now, leaves)
            own = np.inf if moved is None else _mean_square(problem, moved)
            if moved is None or not own <= DIVERGED * first.mean_square:
                failure = f"the training diverges at step {taken}"
            elif own < (1 - LEAST_FALL) * best.mean_square:
                best = _Best(taken, moved, own)
            now = moved or now
        if failure and not best.step:
            raise InputError(
                f"{failure}; give the optimiser a lower learning rate, or write the effect so that "
                "it has a derivative wherever it acts (a root has none at zero, and jnp.where "
                "does not hide that)"
            )
        if failure:
            ended = f"{failure}; what was found at step {best.step} is kept"
            break
        if taken - best.step >= PATIENCE * at_once:
            ended = f"the error no longer fell after step {best.step}"
            break
    chain = best.point.chain.with_effects(jax.tree.map(_stored, best.point.chain.effects))
    end = evaluate(problem, chain, best.point.values, point.strength, best.point)
    end = refine(problem, with_strength(problem, end))
    if not best.step:
        ended = "no step lowered the error; lower the learning rate, or start from other arrays"
    before, after = (float(np.sqrt(each.mean_square)) * problem.unit for each in (first, best))
    numbers = sum(int(np.size(leaf)) for leaf in jax.tree.leaves(leaves))
    return end, Training(tuple(leaves), numbers, taken, best.step, before, after, ended)


def _stored(leaf: Any) -> Any:
    # Double precision that JAX holds can be used only where JAX is told to work in it.
    return np.asarray(leaf) if isinstance(leaf, jax.Array) else leaf


def _mean_square(problem: Problem, point: Point) -> float:
    """Mean square on the fold that chooses the step, in squared output ranges."""
    return float(np.mean(point.residual[np.isin(problem.fold, STOPPING)] ** 2))


def _moved(problem: Problem, point: Point, leaves: Leaves) -> Point | None:
    """The model with other arrays, its other numbers refitted; None if it is not finite."""
    from preisach_jax.fit.gradient import with_leaves

    chain = point.chain.with_effects(with_leaves(point.chain.effects, leaves))
    try:
        moved = evaluate(problem, chain, point.values, point.strength, point, TRAINED)
        return refine(problem, moved, iterations=1)
    except NotFiniteError:
        return None


def _failure(result: TakenSteps, leaves: Leaves, taken: int) -> str:
    """What went wrong in some steps, in a line; empty if nothing did."""
    from preisach_jax.fit.gradient import names_of

    values, finite = np.asarray(result.mean_square), np.asarray(result.finite)
    sound = np.isfinite(values) & finite.all(axis=1)
    if sound.all():
        return ""
    at = int(np.argmin(sound))
    step = taken + at + 1
    if not np.isfinite(values[at]):
        return f"the training diverges at step {step}, where the error is not finite"
    array = names_of(leaves)[int(np.argmin(finite[at]))]
    return f"the effect {array}: the gradient is not finite at step {step}"
