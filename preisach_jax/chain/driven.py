"""What drives the hysterons: the input behind the effects of the input, and their widening."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array

from preisach_jax.chain.compiled import (
    apply_effect,
    as_arrays,
    fed_back_along,
    in_numpy,
    widening_of,
)
from preisach_jax.chain.description import Chain, EffectValues
from preisach_jax.chain.signals import Drive, ThinnedSignals
from preisach_jax.effects.base import HysteresisEffect, InputEffect, Signals


def driven_path(chain: Chain, values: EffectValues, signals: Signals) -> jax.Array:
    """The input behind the effects of the input, `(time,)`."""
    if isinstance(signals, ThinnedSignals):
        return _kept(driven_path(chain, values, signals.whole), signals.kept)
    path = signals.input
    for effect in chain.at(InputEffect):
        path = apply_effect(effect, as_arrays(values[effect.name]), path, signals.time)
    return path


def unrounded_path(chain: Chain, values: EffectValues, signals: Signals) -> jax.Array:
    """The input behind its effects but for steps of converters, which have no rate, `(time,)`."""
    return driven_path(chain.unrounded, values, signals)


def drive(
    chain: Chain, values: EffectValues, signals: Signals, output: ArrayLike | None = None
) -> Drive:
    """What the hysterons see, behind the effects of the input and with those inside.

    Arguments:
        output: (time,) output of the Preisach operator, for an effect that feeds it back; without
            it nothing is fed back.
    """
    path, widened = path_and_widening(chain, values, signals)
    if output is not None:
        for effect in chain.at(HysteresisEffect):
            own = as_arrays(values[effect.name])
            rising = chain.polarity * jnp.asarray(output)
            path = fed_back_along(effect, own, path, rising, signals.time)
    if widened is None:
        return Drive(path)
    path, widened = in_numpy(path), in_numpy(widened)
    return Drive(path - widened, path + widened, None if all_widen(chain) else path)


def path_and_widening(
    chain: Chain, values: EffectValues, signals: Signals
) -> tuple[jax.Array, jax.Array | None]:
    """The input behind the effects of the input, and by how much thresholds move outward."""
    # The speed of the input is that of all samples, also where some are left out.
    thinned = isinstance(signals, ThinnedSignals)
    whole = signals.whole if thinned else signals
    course, widened = driven_path(chain, values, whole), None
    for effect in chain.at(HysteresisEffect):
        shift = widening_of(effect, as_arrays(values[effect.name]), course, whole.time)
        shift = _kept(shift, signals.kept) if thinned else shift
        widened = shift if widened is None else widened + shift
    return _kept(course, signals.kept) if thinned else course, widened


@eqx.filter_jit
def _kept(path: Array, kept: Array) -> Array:
    return path[kept]


def all_widen(chain: Chain) -> bool:
    return any(effect.widens_reversible for effect in chain.at(HysteresisEffect))
