"""A model beside the record on which it was identified."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from preisach_jax import html
from preisach_jax.identify import (
    Point,
)
from preisach_jax.model import Model, Prediction
from preisach_jax.record import Record
from preisach_jax.record.joined import (
    RunErrors,
    errors_by_run,
)
from preisach_jax.rows import (
    chain_rows,
    error_table,
    fault_lines,
    model_line,
    run_lines,
    run_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    """

    record: Record
    model: Model
    prediction: np.ndarray
    identification: np.ndarray
    validation: np.ndarray
    point: Point

    def __repr__(self) -> str:
        return f"<Fit of {self.record.name}: {model_line(self.model)}>"

    def _repr_html_(self) -> str:
        """Errors with units, parameters with their intervals and the plane, for notebooks."""
        return html.block(
            html.heading(f"{self.record.name}: {model_line(self.model)}"),
            html.table(*error_table((self,), self.record), numbers_from=1),
            html.table(*run_table(self.by_record, self.record), numbers_from=1),
            html.table(("acts on", "part", "parameter", "value"), chain_rows(self.model)),
        )

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in the model."""
        return tuple(effect.name for effect in self.model.effects)

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
    def by_record(self) -> tuple[RunErrors, ...]:
        """What the model leaves of each of several records; empty for a single one."""
        return errors_by_run(self.record, self.residual, self.identification, self.validation)

    def summary(self) -> str:
        """Errors and parameters as text."""
        unit = self.record.channels["output"].unit or "(no unit)"
        stroke = np.ptp(self.record.output[self.record.measured])
        rms, largest = self.rms_validation, self.max_abs_validation
        lines = [
            f"Preisach model, {self.model.chain.size_text}"
            + "".join(f" + {name}" for name in self.effects),
            f"  held-out error {rms:.4g} {unit} RMS ({100 * rms / stroke:.3g} % of stroke), "
            f"{largest:.4g} {unit} at most; fit {self.fit_percent:.2f} %",
            f"  identification error {self.rms_identification:.4g} {unit} RMS",
        ]
        lines += [f"  {line}" for line in run_lines(self.by_record, unit)]
        for effect, parameters in self.model.parameters.items():
            for name, estimate in parameters.items():
                lines.append(
                    f"  {effect}.{name} = {estimate.value:.5g} {estimate.unit} "
                    f"(95 %: {estimate.low:.5g} to {estimate.high:.5g})"
                )
        return "\n".join([*lines, *(f"  {line}" for line in fault_lines(self.record))])

    def plot(self) -> Figure:
        """Measured against model, and the residual, as a matplotlib figure."""
        from preisach_jax.plot import overview

        return overview(self)

    def predict(self, record: Record) -> Prediction:
        """Predict the output of a record; see `Model.predict`."""
        return self.model.predict(record)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON; see `Model.save`."""
        self.model.save(path)
