"""Operator creep: creep that small moves do not start."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.effects.base import RATES, AddedEffect, Survey
from preisach_jax.effects.creep import creep_times
from preisach_jax.effects.parameter import Parameter, coefficient

SHARES = (0.05, 0.15, 0.35)
"""Thresholds, in ranges of the input."""


class OperatorCreep(AddedEffect):
    r"""Creep with thresholds: \(\sum_i \sum_j w_i(\log\tau_j)\,y_{ij}\), with creep operators y.

    \[ \tau_j\,\dot y_{ij} = \max(u - y_{ij} - r_i, \min(u - y_{ij} + r_i, 0)) \]

    The weights w are parabolas over the logarithm of time.

    Arguments:
        tau_s: time constants, in s, evenly spaced on a logarithmic scale.
        range_u: range of the input, of which the thresholds are shares.

    Example:
        >>> [p.name for p in OperatorCreep().coefficients()][:4]
        ['gain_1', 'tilt_1', 'bend_1', 'gain_2']
    """

    name = "operator_creep"
    rank = 2
    in_words = (
        "creep with a threshold (after large moves the output goes on moving, after "
        "small ones it does not)"
    )
    # Its nine columns follow much that is slow and bent, whatever it is.
    on_request = True
    physics = (
        "A domain wall held by a pinning site creeps on only where the field has left it by more "
        "than the site's strength. Creep then starts from a threshold: a great move is followed by "
        "more creep than in proportion, a small one on the way back by none, and what has crept "
        "is kept as a play keeps its place."
    )
    source = (
        "P. Krejci, K. Kuhnen, IEE Proc. Control Theory Appl. 148 (2001) 185-192; K. Kuhnen, "
        "Eur. J. Control 9 (2003) 407-418 (log(t)-type creep operators with thresholds)"
    )
    signature = (
        "slow tails after large moves, none after small moves or on the way back from a turn"
    )
    confused_with = ("creep", "log_rate")
    needs = (RATES,)
    experiment = (
        "holds of equal length after moves of five or more sizes, in both directions and after a "
        "turn: linear creep is in proportion to the move, creep with a threshold is not"
    )
    tau_s: tuple[float, ...] = (0.1, 1.0, 10.0)
    range_u: float = 1.0

    def coefficients(self) -> tuple[Parameter, ...]:
        forms = {
            "gain": "mean creep a decade of time beyond",
            "tilt": "how much more of it in long times than in short ones beyond",
            "bend": "how much more of it in short and long times than between beyond",
        }
        return tuple(
            coefficient(
                f"{name}_{i}", "{z}/{u}", f"{meaning} {100 * share:.0f} % of the input's range"
            )
            for i, share in enumerate(SHARES, start=1)
            for name, meaning in forms.items()
        )

    def bound_to(self, survey: Survey) -> OperatorCreep:
        swing = float(np.ptp(survey.input)) if len(survey.input) else 1.0
        return OperatorCreep(creep_times(survey), swing)

    def _spectrum(self, xp: Any) -> Any:
        """(element, 3) parabolas over the logarithm of time, in shares of a decade."""
        count = len(self.tau_s)
        even = xp.linspace(-1.0, 1.0, count)
        spectrum = xp.stack([xp.ones_like(even), even, 1.5 * even**2 - 0.5], axis=1)
        return spectrum * xp.log10(self.tau_s[-1] / self.tau_s[0]) / (count - 1)

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        gains = np.asarray(amounts).reshape(len(SHARES), 3) @ self._spectrum(np).T
        return {
            "threshold": tuple(self.range_u * share for share in SHARES),
            "tau": tuple(tau_s / step_s for tau_s in self.tau_s),
            "gain": tuple(gains.ravel().tolist()),
        }

    def init(self, first: Array) -> tuple[Array, Array]:
        return jnp.broadcast_to(first, (len(SHARES), len(self.tau_s))), first

    def step(
        self, state: tuple[Array, Array], value: Array, dt: Array
    ) -> tuple[tuple[Array, Array], Array]:
        place, before = state
        threshold = (self.range_u * jnp.asarray(SHARES))[:, None]
        tau_s = jnp.asarray(self.tau_s)[None, :]
        place = creep_step(place, before, value, dt, threshold, tau_s)
        return (place, value), (place @ self._spectrum(jnp)).ravel()


def creep_step(
    place: Array | float,
    before: Array | float,
    now: Array | float,
    dt: Array,
    threshold: Array,
    tau_s: Array,
) -> Array:
    """Elementary creep operators after `dt`, exact for an input that goes straight.

    Arguments:
        place: their outputs, in input units.
        dt: length of the step in s; at zero nothing moves.
        tau_s: time constant in s, positive.
    """
    safe_dt = jnp.where(dt > 0, dt, 1.0)
    slope = (now - before) / safe_dt
    lag = slope * tau_s  # the distance at which a pulled output would follow for ever
    # At first an output may be pulled, until it has reached the input's threshold ...
    distance = before - place
    ahead = distance - jnp.clip(distance, -threshold, threshold)
    meets = ahead * lag < 0
    share = jnp.where(meets, lag / jnp.where(meets, lag - ahead, 1.0), 1.0)
    until = jnp.where(meets, -tau_s * jnp.log(share), jnp.where(ahead == 0, 0.0, safe_dt))
    until = jnp.minimum(until, safe_dt)
    place = place + slope * until - (lag - ahead) * -jnp.expm1(-until / tau_s) * (until > 0)
    # ... then it rests, until the input pulls it by the other threshold or by the same again.
    reached = before + slope * until
    gap = jnp.sign(slope) * (place - reached) + threshold
    moving = slope != 0
    rest = jnp.where(moving, gap / jnp.where(moving, jnp.abs(slope), 1.0), jnp.inf)
    left = jnp.maximum(safe_dt - until - jnp.maximum(rest, 0.0), 0.0)
    pulled = place + slope * left - lag * -jnp.expm1(-left / tau_s)
    return jnp.where(dt > 0, jnp.where(left > 0, pulled, place), place * jnp.ones_like(tau_s))
