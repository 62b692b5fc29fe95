"""Reptation, or accommodation: minor loops creep towards their equilibrium, cycle by cycle."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.effects.base import CYCLES, AddedEffect, Survey
from preisach_jax.effects.parameter import Parameter, coefficient, parameter

SHARES = (0.1, 0.2, 0.35)
"""Half widths of the plays, in ranges of the input."""


class Reptation(AddedEffect):
    r"""What plays lose on the way: \(\sum_i w_i\,(q_i - p_i)\), with a play p and a leaky one q.

    Both rest within r of the input u, and the leaky one goes towards it with every move:

    \[ \frac{dq_i}{ds} = \frac{u - q_i}{s_0}, \quad ds = |du|, \quad |u - q_i| \le r_i \]

    Arguments:
        range_u: range of the input, of which the half widths r are shares.

    Example:
        >>> [p.name for p in Reptation().parameters()], [p.name for p in Reptation().coefficients()]
        (['path'], ['gain_1', 'gain_2', 'gain_3'])
    """

    name = "reptation"
    rank = 3
    needs_clock = False
    in_words = "reptation (repeated loops drift towards their middle, whatever the rate)"
    physics = (
        "Every cycle changes the fields by which the domains act on each other, and so helps some "
        "of those over their barriers that the cycle itself would not switch. What an earlier "
        "great move has left is forgotten with the path that the input travels, not with time: a "
        "minor loop that is repeated moves, less and less, towards the middle of the major loop."
    )
    source = (
        "L. Néel, J. Phys. Radium 20 (1959) 215-221 (reptation); E. Della Torre, Magnetic "
        "Hysteresis, IEEE Press 1999, ch. 5 (accommodation)"
    )
    signature = (
        "repeated minor loops that do not close and shift less and less; nothing at rest, and the "
        "same at every rate"
    )
    confused_with = ("creep", "drift")
    needs = (CYCLES,)
    experiment = (
        "after a great move, one minor loop twenty times at two rates with holds between: "
        "reptation goes by the number of loops, creep and drift by the time"
    )
    range_u: float = 1.0
    path: float = parameter(
        "{u}",
        lambda own: 0.3 * own.range_u,
        lambda own: 30.0 * own.range_u,
        log=True,
        per_decade=1.0,
        meaning="travel of the input on which what it does not hold is forgotten to 1/e",
        open_ended="above",
    )

    def coefficients(self) -> tuple[Parameter, ...]:
        return tuple(
            coefficient(
                f"gain_{i}",
                "{z}/{u}",
                f"output of the play of {100 * share:.0f} % of the input's range",
            )
            for i, share in enumerate(SHARES, start=1)
        )

    def bound_to(self, survey: Survey) -> Reptation:
        return Reptation((float(np.ptp(survey.input)) if len(survey.input) else 0.0) or 1.0)

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        reach = tuple(self.range_u * share for share in SHARES)
        return {"reach": reach, "gain": amounts, "path": self.path}

    def init(self, first: Array) -> tuple[Array, Array, Array]:
        start = jnp.broadcast_to(first, len(SHARES))
        return start, start, first

    def step(
        self, state: tuple[Array, Array, Array], value: Array, dt: Array
    ) -> tuple[tuple[Array, Array, Array], Array]:
        del dt
        tight, leaky, before = state
        reach = self.range_u * jnp.asarray(SHARES)
        tight = jnp.clip(tight, value - reach, value + reach)
        # Exact on the straight way between two samples, on which a bound is met but once.
        travel = jnp.abs(value - before) / self.path
        safe = jnp.where(travel > 0, travel, 1.0)
        trail = (value - before) * jnp.where(travel > 0, -jnp.expm1(-safe) / safe, 1.0)
        leaky = value - trail + jnp.exp(-travel) * (leaky - before)
        leaky = jnp.clip(leaky, value - reach, value + reach)
        return (tight, leaky, value), leaky - tight
