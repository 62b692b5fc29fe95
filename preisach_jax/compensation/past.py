"""What was played before a wanted course: it sets the memory from which the drive starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.effects.base import Signals
from preisach_jax.errors import InputError
from preisach_jax.model import Model
from preisach_jax.record.core import Record

PAUSE_STEPS = 1.5
"""Time steps between the past and the course from which on the input is held between them."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Time in s, input and auxiliary columns, `(row,)` each."""

    time: np.ndarray
    input: np.ndarray
    aux: Mapping[str, np.ndarray]

    @staticmethod
    def of(record: Record) -> Rows:
        """Those of a record."""
        return Rows(record.time, record.input, record.aux)

    def then(self, later: Rows) -> Rows:
        """These rows and later ones."""
        aux = {k: np.concatenate([v, later.aux[k]]) for k, v in self.aux.items()}
        time = np.concatenate([self.time, later.time])
        return Rows(time, np.concatenate([self.input, later.input]), aux)


@dataclass(frozen=True, eq=False)
class Past:
    """The rows before a wanted course, and the numbers with which the model begins them.

    Attributes:
        rows: all rows before the course, also those of the fit.
        known: how many of the first of them `Model.predict` knows by itself.
        origin_s: time that is zero for the effects.
        coefficients: the model's, with the initial memory of the first of these rows.
        initial_memory: what is stated of the memory before them.
        time: (sample,) time of the course on the clock of these rows, in s.
    """

    rows: Rows
    known: int
    origin_s: float
    coefficients: Coefficients
    initial_memory: str
    time: np.ndarray

    @property
    def count(self) -> int:
        """How many rows stand before the course."""
        return len(self.rows.time)

    @property
    def last_input(self) -> float:
        """The input in the last of them, at which the drive starts."""
        return float(self.rows.input[-1])

    @property
    def pause_s(self) -> float:
        """Time from the last of them to the course, in s."""
        return float(self.time[0] - self.rows.time[-1])

    def signals(self, drive: np.ndarray, aux: Mapping[str, np.ndarray]) -> Signals:
        """The signals of the past and of the course together."""
        whole = self.rows.then(Rows(self.time, drive, aux))
        columns: dict[str, Any] = dict(whole.aux)
        time: Any = whole.time - self.origin_s
        values: Any = whole.input
        return Signals(time, values, columns)

    def record(self, drive: np.ndarray, aux: Mapping[str, np.ndarray]) -> Record:
        """A record of the past and of the course together, for `Model.predict`."""
        whole = self.rows.then(Rows(self.time, drive, aux))
        new = slice(self.known, None)
        time = whole.time[new]
        return Record.from_arrays(
            time,
            whole.input[new],
            np.full(len(time), np.nan),
            aux={name: values[new] for name, values in whole.aux.items()},
            name="the drive",
            initial_memory=self.initial_memory,
        )


def past_of(model: Model, wanted: Record, after: Record | None) -> Past:
    """The past of a wanted course."""
    known, memory, coefficients = 0, "free", model.coefficients
    origin_s = model.origin.start_s
    fitted = _fitted(model, wanted)
    if after is None:
        rows, known = fitted, len(fitted.time)
    else:
        for name in wanted.aux:
            if name not in after.aux:
                raise InputError(
                    f"{after.name}: the model needs the auxiliary column {name!r}; load the record "
                    f"with it (--aux {name})"
                )
        rows, memory = Rows.of(after), after.initial_memory
        if model.follows_origin(after):
            rows, known = fitted.then(rows), len(fitted.time)
        elif not model.begins_with_origin(after):
            signals, coefficients = model.unknown_start(after)
            origin_s = float(after.time[0] - np.asarray(signals.time)[0])
    end, step = float(rows.time[-1]), wanted.step_s
    first = float(wanted.time[0])
    shift = 0.0 if first > end else end + step - first
    past = Past(rows, known, origin_s, coefficients, memory, wanted.time + shift)
    begins = first + shift
    rests = [begins - step] if begins - end > PAUSE_STEPS * step else []
    if after is None and begins - end > model.origin.step_s:
        # So near to the record of the fit, `Model.predict` takes it for its continuation.
        rests.insert(0, end + model.origin.step_s)
    return _held(past, rests)


def _fitted(model: Model, wanted: Record) -> Rows:
    """The thinned input of the fit; auxiliary columns, which are not kept, as the course begins."""
    time, values = model.origin.history
    aux = {name: np.full(len(time), column[0]) for name, column in wanted.aux.items()}
    return Rows(time, values, aux)


def _held(past: Past, rests: list[float]) -> Past:
    """The past with more rows before the course, in which the input rests."""
    last, begins = past.rows, float(past.time[0])
    rests = [at for at in rests if last.time[-1] < at < begins]
    time = np.unique(rests)
    aux = {name: np.full(len(time), values[-1]) for name, values in last.aux.items()}
    rows = last.then(Rows(time, np.full(len(time), past.last_input), aux))
    return Past(rows, past.known, past.origin_s, past.coefficients, past.initial_memory, past.time)
