"""What drives a model along a record."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Int

from preisach_jax.effects.base import (
    Signals,
)
from preisach_jax.record import Record


def signals_of(record: Record, origin_s: float | None = None) -> Signals:
    """What of a record drives a model, on the device.

    Arguments:
        record: the record.
        origin_s: time of the record that is zero for the effects; its first sample by default.
    """
    origin = record.time[0] if origin_s is None else origin_s
    return Signals(
        jnp.asarray(record.time - origin),
        jnp.asarray(record.input),
        {name: jnp.asarray(values) for name, values in record.aux.items()},
    )


class ThinnedSignals(Signals):
    """Signals of some samples of a record, with all of them for the effects of the input.

    Attributes:
        whole: the signals of all samples.
        kept: (time,) indices of the samples that are kept.
    """

    whole: Signals
    kept: Int[Array, " time"]


class Drive(NamedTuple):
    """What the hysterons see, `(time,)`: at their thresholds α, and at β where that differs.

    Those on the diagonal, which are reversible, see `reversible` where that differs too.
    """

    rising: Array
    falling: Array | None = None
    reversible: Array | None = None
