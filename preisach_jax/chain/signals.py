"""What drives a model along a record, of one run or of several."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from preisach_jax.effects.base import Signals
from preisach_jax.record.core import Record


def signals_of(record: Record, origin_s: float | None = None) -> Signals:
    """What of a record drives a model, on the device."""
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

    @property
    def path(self) -> Float[Array, " time"]:
        """Path of the input before each sample, with that of the samples between them."""
        return self.whole.path[self.kept]


class JoinedSignals(Signals):
    """Signals of several runs, end to end.

    Attributes:
        parts: the signals of each run, whose time begins with it.
        memories: state of the hysterons at the first sample of each.
        held_out: whether all of a run is held out.
    """

    parts: tuple[Signals, ...]
    memories: tuple[str, ...] = eqx.field(static=True)
    held_out: tuple[bool, ...] = eqx.field(static=True)

    @property
    def fitted(self) -> list[int]:
        """Positions of the runs that are not held out."""
        return [position for position, out in enumerate(self.held_out) if not out]

    @property
    def rows(self) -> list[slice]:
        """The samples of each run."""
        ends = np.cumsum([0, *(len(part.time) for part in self.parts)]).tolist()
        return [slice(start, stop) for start, stop in itertools.pairwise(ends)]


def parts_of(signals: Signals) -> tuple[Signals, ...]:
    """The signals of each run."""
    return signals.parts if isinstance(signals, JoinedSignals) else (signals,)


def each_run(change: Callable[[Signals], Signals], signals: Signals) -> Signals:
    """Signals whose runs are each changed alone, end to end again."""
    if not isinstance(signals, JoinedSignals):
        return change(signals)
    parts = tuple(map(change, signals.parts))
    return replace(
        signals,
        time=jnp.concatenate([part.time for part in parts]),
        input=jnp.concatenate([part.input for part in parts]),
        aux={name: jnp.concatenate([part.aux[name] for part in parts]) for name in signals.aux},
        parts=parts,
    )


class Drive(NamedTuple):
    """What the hysterons see, `(time,)`: at their thresholds α, and at β where that differs.

    Those on the diagonal, which are reversible, see `reversible` where that differs too.
    """

    rising: Array
    falling: Array | None = None
    reversible: Array | None = None
