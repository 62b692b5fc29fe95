"""A model beside the record on which it was identified."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from preisach_jax.fit.training import Training
from preisach_jax.hooks import HOOKS
from preisach_jax.identify import Point
from preisach_jax.loss import Loss, loss_per_cycle, magnet_of
from preisach_jax.model import Model, Prediction
from preisach_jax.quantity import quantity
from preisach_jax.record import Record
from preisach_jax.record.joined import RunErrors, errors_by_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure


RISE = 1e-3
"""Relative rise of a held-out error from which on it is told: less is not seen in its digits."""


@dataclass(frozen=True)
class Added:
    """What adding effects to a model did to its error on the rows held out.

    Attributes:
        effects: their names.
        before, after: the RMS error, in output units, as the search saw it: of a long record on
            the rows to which it was thinned.
    """

    effects: tuple[str, ...]
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A model fitted to a record, with what it leaves.

    Attributes:
        record: the record.
        model: the model, identified on all rows.
        prediction: (time,) output of the same model identified on the identification rows alone.
        identification: (time,) rows that identified `prediction`.
        validation: (time,) rows held out: contiguous blocks spread over the record.
        point: the numerical state, from which a larger model starts; possibly without regressors.
        training: how the arrays of its effects were trained; None if they were not.
        added: what each effect did to the held-out error as it was added, in their order; of
            effects that were trained, what all of them did.
    """

    record: Record
    model: Model
    prediction: np.ndarray
    identification: np.ndarray
    validation: np.ndarray
    point: Point
    training: Training | None = None
    added: tuple[Added, ...] = ()

    def __repr__(self) -> str:
        return f"<Fit of {self.record.name}: {self.model.line}>"

    def _repr_html_(self) -> str:
        return HOOKS["Fit._repr_html_"](self)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in the model."""
        return tuple(effect.name for effect in self.model.effects)

    @property
    def name(self) -> str:
        """The model by its effects."""
        return self.model.name

    @property
    def residual(self) -> np.ndarray:
        """(time,) measured minus predicted output; NaN where nothing was measured."""
        return self.record.output - self.prediction

    @property
    def rms_identification(self) -> float:
        """RMS residual on the identification rows, in output units."""
        return float(np.sqrt(np.mean(self.residual[self.identification] ** 2)))

    @property
    def rms_validation(self) -> float:
        """RMS residual on the held-out rows, in output units."""
        return float(np.sqrt(np.mean(self.residual[self.validation] ** 2)))

    @property
    def max_abs_validation(self) -> float:
        """Largest residual on the held-out rows, in output units."""
        return float(np.max(np.abs(self.residual[self.validation])))

    @property
    def fit_percent(self) -> float:
        r"""\(100\,(1 - \|e\| / \|z - \bar z\|)\) on the held-out rows."""
        output = self.record.output[self.validation]
        spread = np.linalg.norm(output - output.mean())
        return float(100 * (1 - np.linalg.norm(self.residual[self.validation]) / spread))

    @property
    def rises(self) -> tuple[str, ...]:
        """A sentence on each effect whose adding raised the held-out error."""
        unit = self.record.output_unit
        return tuple(
            f"adding {', '.join(each.effects)} raised the held-out error from "
            f"{quantity(each.before, unit, 4)} to {quantity(each.after, unit, 4)} RMS: leave it "
            "out, unless it is known to act and the record to be poor"
            for each in self.added
            if not each.after <= (1 + RISE) * each.before
        )

    @property
    def by_record(self) -> tuple[RunErrors, ...]:
        """What the model leaves of each of several records; empty for a single one."""
        return errors_by_run(self.record, self.residual, self.identification, self.validation)

    @cached_property
    def loss(self) -> Loss | None:
        """Of a magnet, what its closed cycles lose; None if the units are not those of H and B."""
        return loss_per_cycle(self.record, self.model) if magnet_of(self.record) else None

    def summary(self) -> str:
        """Errors and parameters as text."""
        return HOOKS["Fit.summary"](self)

    def plot(self) -> Figure:
        """Measured against model, and the residual, as a matplotlib figure."""
        return HOOKS["Fit.plot"](self)

    def predict(self, record: Record) -> Prediction:
        """Predict the output of a record; see `Model.predict`."""
        return self.model.predict(record)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON; see `Model.save`."""
        self.model.save(path)
