r"""TakenSteps of an optimiser on the arrays of effects, with the density projected out.

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

from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float
from optax import GradientTransformationExtraArgs, apply_updates

from preisach_jax.chain import Chain
from preisach_jax.chain.compiled import ROUND_COLUMNS, as_arrays
from preisach_jax.chain.differentiable import DrivenRun, on_the_unit_plane, output_along
from preisach_jax.chain.runs import of_run
from preisach_jax.chain.signals import JoinedSignals, parts_of
from preisach_jax.effects.arrays import is_floating
from preisach_jax.effects.base import Effect, Values
from preisach_jax.identify import Point, Problem

Leaves = dict[str, Any]
"""By effect, the arrays that are trained, in the effect's own tree; None in all other places."""


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
        """(row,) residual that the coefficients leave which are best for these arrays.

        Arguments:
            before: (row,) output with the arrays of the last solution.
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
        moved: Any = apply_updates(now, updates)
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
