r"""Effects that hold arrays, trained by an optimiser, with the density projected out.

At weights \(\theta\) of the effects the linear coefficients are those that are best for them, so
that the objective is

\[ f(\theta) = \min_c \frac1n \|z - \hat z(\theta, c)\|^2 + \lambda\, c^\top P c, \]

whose gradient is the partial one in \(\theta\) at the best c, by the envelope theorem (G. Golub,
V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432).  Between two solutions for c, the coefficients
follow the residual r by their normal equations, \(\delta = G^{-1} A^\top (r - r_0)\), with the
regressors A and the residual \(r_0\) of the last solution: the gradient is exact there, and
differs from it by second order in what the steps since have changed.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from preisach_jax.chain.compiled import ROUND_COLUMNS, as_arrays
from preisach_jax.chain.description import Chain
from preisach_jax.chain.differentiable import DrivenRun, on_the_unit_plane, output_along
from preisach_jax.chain.runs import of_run
from preisach_jax.chain.signals import JoinedSignals, parts_of
from preisach_jax.effects.base import Effect, Values, is_floating
from preisach_jax.errors import InputError, NotFiniteError, whole_number
from preisach_jax.fit.stepwise import Progress, in_silence
from preisach_jax.identify.gauss_newton import refine
from preisach_jax.identify.problem import IDENTIFICATION, Point, Problem, evaluate, with_strength

if TYPE_CHECKING:
    from optax import GradientTransformation, GradientTransformationExtraArgs

TRAINING_STEPS = 2_000
"""Steps of an optimiser, at most, if nothing else is asked for."""

STEPS_AT_ONCE = 25
"""Steps from one solution for the linear coefficients to the next."""

PATIENCE = 10
"""Such rounds without a better model until the training ends."""

LEAST_FALL = 1e-3
"""Relative fall of the mean square by which a model is better."""

DIVERGED = 25.0
"""Times the mean square at the start at which a training has diverged."""

TRAINED, STOPPING = IDENTIFICATION[:-1], IDENTIFICATION[-1:]
"""Folds of the rows that identify: those by which arrays are trained, and the one that says which
step is the best.  The rows that are held out take no part in either."""

Leaves = dict[str, Any]
"""By effect, the arrays that are trained, in the effect's own tree; None in all other places."""


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


def leaves_of(effects: tuple[Effect, ...]) -> Leaves:
    """The arrays of some effects that are trained, without the effects that have none."""
    found: Leaves = {effect.name: eqx.filter(effect, is_floating) for effect in effects}
    return {name: own for name, own in found.items() if jax.tree.leaves(own)}


def with_leaves(effects: tuple[Effect, ...], leaves: Leaves) -> tuple[Effect, ...]:
    """Some effects with other arrays."""
    return tuple(
        eqx.combine(leaves[effect.name], effect) if effect.name in leaves else effect
        for effect in effects
    )


def names_of(leaves: Leaves) -> list[str]:
    """What each array is called in messages: its effect, and its place in the effect."""
    found: list[str] = []
    for effect, own in leaves.items():
        for path, _ in cast(list[tuple[Any, Any]], jax.tree_util.tree_leaves_with_path(own)):
            place = jax.tree_util.keystr(path)
            found.append(f"{effect!r}, {place}" if place else repr(effect))
    return found


class VariableProjection(eqx.Module):
    """All that stays while the arrays of effects are trained from one solution to the next.

    Attributes:
        chain: what is in the model, on the plane from 0 to 1.
        scale: lower limit and width of its plane.
        values: nonlinear parameters of the effects.
        runs: what drives it.
        rows: (row,) samples by which the arrays are trained, end to end over the runs.
        left: (row,) residual of the last solution, in output ranges.
        unit: () output range, in output units.
        matrix: (row, column) regressors A of the last solution, and columns of zeros.
        inverse: (column, column) inverse of their penalised normal equations G; zero for weights
            at their bound.
    """

    chain: Chain
    scale: tuple[np.ndarray, np.ndarray]
    values: dict[str, Values]
    runs: tuple[DrivenRun, ...]
    rows: np.ndarray
    left: np.ndarray
    unit: np.ndarray
    matrix: np.ndarray
    inverse: np.ndarray

    @staticmethod
    def of(problem: Problem, point: Point, changing: tuple[str, ...]) -> VariableProjection:
        """The projection from a point on, by the rows that identify it."""
        chain, coefficients, signals = point.chain, point.coefficients(), problem.signals
        runs: list[DrivenRun] = []
        for position, part in enumerate(parts_of(signals)):
            own = coefficients
            if isinstance(signals, JoinedSignals):
                own = of_run(chain, coefficients, signals, position)
            runs.append(DrivenRun.of(chain, point.values, part, own, changing))
        unit_chain, scale = on_the_unit_plane(chain)
        inside = np.isin(problem.fold, point.folds)
        # How many columns an unknown past takes differs from one solution to the next.
        lacking = -point.matrix.shape[1] % ROUND_COLUMNS
        return VariableProjection(
            unit_chain,
            scale,
            {name: as_arrays(own) for name, own in point.values.items()},
            tuple(runs),
            problem.rows[inside],
            point.residual[inside],
            np.asarray(problem.unit),
            np.pad(point.matrix[inside], ((0, 0), (0, lacking))),
            np.pad(_inverse(point), (0, lacking)),
        )

    def output(self, leaves: Leaves) -> Float[Array, " row"]:
        """(row,) output of the model at the last coefficients, in output ranges."""
        effects = with_leaves(self.chain.effects, leaves)
        chain, names = self.chain.with_effects(effects), tuple(leaves)
        outputs = [output_along(chain, self.scale, self.values, run, names) for run in self.runs]
        return jnp.concatenate(outputs)[self.rows] / self.unit

    def projected(self, leaves: Leaves, before: Float[Array, " row"]) -> Float[Array, " row"]:
        """(row,) residual with the coefficients that are best for these arrays.

        `before` is the output with the arrays of the last solution.
        """
        change = self.output(leaves) - before
        answer = self.inverse @ (self.matrix.T @ jax.lax.stop_gradient(change))
        return jnp.asarray(self.left) - change + self.matrix @ answer


def _inverse(point: Point) -> np.ndarray:
    gram, _ = point.equations.system(point.folds, point.strength)
    free = np.flatnonzero(~point.equations.nonnegative | (point.solution > 0))
    inverse = np.zeros_like(gram)
    own = gram[np.ix_(free, free)]
    inverse[np.ix_(free, free)] = scipy.linalg.inv(own, check_finite=False)
    return inverse


class TakenSteps(NamedTuple):
    """What some steps of an optimiser lead to.

    Attributes:
        leaves, state: the arrays and the state of the optimiser behind the last step.
        mean_square: (step,) before each step, in squared output ranges.
        finite: (step, array) whether all of the gradient is finite.
    """

    leaves: Leaves
    state: Any
    mean_square: Array
    finite: Array


@eqx.filter_jit
def steps_taken(
    projection: VariableProjection,
    leaves: Leaves,
    state: Any,
    optimiser: GradientTransformationExtraArgs,
    count: int,
) -> TakenSteps:
    """Take some steps of an optimiser, compiled as one loop."""
    before = projection.output(leaves)

    def mean_square(now: Leaves) -> Array:
        return jnp.mean(projection.projected(now, before) ** 2)

    def step(carry: tuple[Leaves, Any], _: None) -> tuple[tuple[Leaves, Any], tuple[Array, Array]]:
        now, state = carry
        value, gradient = jax.value_and_grad(mean_square)(now)
        finite = jnp.stack([jnp.isfinite(each).all() for each in jax.tree.leaves(gradient)])
        updates, state = optimiser.update(
            gradient, state, now, value=value, grad=gradient, value_fn=mean_square
        )
        moved = cast(Leaves, eqx.apply_updates(now, updates))
        return (moved, state), (value, finite)

    (leaves, state), (values, finite) = jax.lax.scan(step, (leaves, state), length=count)
    return TakenSteps(leaves, state, values, finite)


_known: dict[tuple[object, ...], GradientTransformationExtraArgs] = {}


def shared(
    optimiser: GradientTransformationExtraArgs, leaves: Leaves
) -> GradientTransformationExtraArgs:
    """The first optimiser that computed what this one does, for which steps are compiled already.

    Optimisers are closures, which are new each time one is made; what they compute is compared.
    """
    value = jnp.zeros(())

    def update(gradient: Leaves, state: Any, now: Leaves) -> Any:
        def value_fn(own: Leaves) -> Array:
            return sum((jnp.sum(each) for each in jax.tree.leaves(own)), value)

        return optimiser.update(gradient, state, now, value=value, grad=gradient, value_fn=value_fn)

    traced = jax.make_jaxpr(update)(leaves, optimiser.init(leaves), leaves)
    constants = tuple(np.asarray(each).tobytes() for each in traced.consts)
    return _known.setdefault((str(traced.jaxpr), constants), optimiser)


def in_double(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Some effects whose arrays are in double precision, if any of them has arrays to train."""
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

    Where the training fails after it has found a better model than that of the start, it is that
    model.
    """
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
    chain = point.chain.with_effects(with_leaves(point.chain.effects, leaves))
    try:
        moved = evaluate(problem, chain, point.values, point.strength, point, TRAINED)
        return refine(problem, moved, iterations=1)
    except NotFiniteError:
        return None


def _failure(result: TakenSteps, leaves: Leaves, taken: int) -> str:
    """What went wrong in some steps, in a line; empty if nothing did."""
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
