r"""Whether an effect of one's own keeps the law that its place in the chain rests on.

An effect of the output is applied to each column of the hysterons by itself, which is right only
where \(F(a x + b y) = a F(x) + b F(y)\); the reading of a sensor is solved for sample by sample.
What breaks either is fitted wrongly without any other sign.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.effects.base import Effect, OutputEffect, SensorEffect, Survey
from preisach_jax.errors import EffectError

SAMPLES = 64

INSIDE = (0.3, 0.7)
"""Where between the bounds of its parameters an effect is asked: at an end it may do nothing."""

ROUNDING = 1e-6
"""Deviation over the greatest value beyond which it is the law's and not that of rounding."""

MIXED = (0.6, -1.3)
"""How much of two signals a third one is made of; the sum is not 1, so that constants show."""


def require_law_of_place(effect: Effect, survey: Survey) -> None:
    """Refuse an effect of the output that is not linear, or one of the sensor with a memory."""
    if not isinstance(effect, OutputEffect | SensorEffect):
        return
    rng = np.random.default_rng(0)
    size = float(np.ptp(survey.output)) or 1.0
    first = survey.output.mean() + size * rng.uniform(-1, 1, SAMPLES)
    second = size * np.cumsum(rng.normal(size=SAMPLES)) / np.sqrt(SAMPLES)
    order = rng.permutation(SAMPLES)
    mixed = MIXED[0] * first + MIXED[1] * second
    signals = np.stack([first, second, mixed, first[order], np.zeros(SAMPLES)])
    time = jnp.asarray(survey.step_s * np.arange(SAMPLES))
    if isinstance(effect, SensorEffect):
        for law in ("columns", "converted"):
            made = _made(
                effect, lambda own, each, law=law: getattr(own, law)(each), signals[[0, 3]]
            )
            if made.shape[2:3] == (SAMPLES,) and _differ(made[:, 1], made[:, 0][:, order]):
                raise EffectError(
                    f"the effect {effect.name!r} is a SensorEffect, but its {law} at a sample "
                    "depend on other samples: what has a memory and is linear is a "
                    "pj.OutputEffect, else give columns of the input in a pj.AddedEffect"
                )
        return
    made = _made(effect, lambda own, each: own.apply(each, time), signals)
    if made.shape[2:] != (SAMPLES,):
        return
    one, other, both, shuffled, nothing = np.moveaxis(made, 1, 0)
    summed = MIXED[0] * one + MIXED[1] * other
    if not _differ(both, summed):
        return
    share = (1 - sum(MIXED)) * nothing
    remedy = "what has a memory and is not linear belongs before the hysteresis (pj.InputEffect)"
    if not _differ(both, summed + share):
        remedy = "what it adds to any signal belongs into the columns of a pj.AddedEffect"
    elif not _differ(shuffled, one[:, order]):
        remedy = "it has no memory: derive it from pj.SensorEffect, with columns of the reading"
    raise EffectError(
        f"the effect {effect.name!r} is an OutputEffect, but not linear in its signal: it acts on "
        "each hysteron by itself, which then does not add up to what it makes of their sum; "
        f"{remedy}"
    )


def _made(
    effect: Effect, law: Callable[[Any, jax.Array], jax.Array], signals: np.ndarray
) -> np.ndarray:
    """(place, signal, ...) what an effect makes of signals, at places inside its bounds."""
    values: dict[str, list[float]] = {}
    for p in effect.parameters():
        low, high = (p.to_search(end) for end in (p.low, p.high))
        finite = np.isfinite(high - low)
        values[p.name] = [
            p.from_search(low + share * (high - low)) if finite else p.start[0] + share
            for share in INSIDE
        ]
    own = {name: jnp.asarray(each) for name, each in values.items()}

    def along(place: jax.Array) -> jax.Array:
        acting = effect.at({name: each[place] for name, each in own.items()})
        return jax.vmap(partial(law, acting))(jnp.asarray(signals))

    # Compiled: op by op, each of dozens of operations would be compiled by itself.
    return np.asarray(cast(Any, jax.jit)(jax.vmap(along))(jnp.arange(len(INSIDE))))


def _differ(found: np.ndarray, expected: np.ndarray) -> bool:
    """Whether results differ by more than rounding at a place; what is not finite says nothing."""
    for own, other in zip(found, expected, strict=True):
        most = ROUNDING * max(np.abs(own).max(initial=0.0), np.abs(other).max(initial=0.0))
        if np.isfinite(most) and np.abs(own - other).max(initial=0.0) > most:
            return True
    return False
