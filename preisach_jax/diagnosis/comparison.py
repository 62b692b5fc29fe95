"""An existing model against a record: errors and residual tests."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from preisach_jax.diagnosis.past import of_the_beginning
from preisach_jax.diagnosis.residuals import (
    autocorrelation,
    cross_correlation,
    cumulated_periodogram,
    in_sequence,
    longest_lag,
)
from preisach_jax.diagnosis.wording import located
from preisach_jax.model import Model, Prediction, past_sentence
from preisach_jax.record.blemishes import fault_lines
from preisach_jax.record.core import Record
from preisach_jax.record.faults import faults
from preisach_jax.record.jumps import jumps
from preisach_jax.record.spikes import gross_spikes, input_spikes, isolated_spikes


@dataclass(frozen=True)
class ResidualTests:
    """What is left in a residual that chance would not leave.

    Attributes:
        bias: mean residual, in output units.
        inside_band: share of the measured samples inside the model's 95 % band.
        autocorrelation_outside: share of the lags outside the 99 % band of white noise.
        cross_correlation_outside: the same for the correlation with the input.
        periodogram_deviation: largest distance of the cumulated periodogram from white noise.
        periodogram_band: what it stays within for 99 of 100 white residuals.
    """

    bias: float
    inside_band: float
    autocorrelation_outside: float
    cross_correlation_outside: float
    periodogram_deviation: float
    periodogram_band: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """A model's prediction beside a measurement that took no part in it.

    Attributes:
        model: the model.
        record: the measurement, without what stands out alone.
        simulated: the model's prediction, with its band.
        tests: tests of the residual.
    """

    model: Model
    record: Record
    simulated: Prediction
    tests: ResidualTests

    @property
    def prediction(self) -> np.ndarray:
        """(time,) predicted output."""
        return self.simulated.output

    @property
    def residual(self) -> np.ndarray:
        """(time,) measured minus predicted output; NaN where nothing was measured."""
        return self.record.output - self.simulated.output

    @property
    def validation(self) -> np.ndarray:
        """(time,) bool: the model has seen none of these rows' outputs."""
        return self.record.measured

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in the model."""
        return tuple(effect.name for effect in self.model.effects)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader must know of the record before believing the errors."""
        lines = fault_lines(self.record)
        past = past_sentence(self.model, self.record, self.simulated)
        begins = of_the_beginning(self.record, self.residual)
        sits = f"Where the error sits: {self.located}"
        return tuple(f"{line}." for line in (*lines, past, begins, sits) if line)

    @property
    def located(self) -> str:
        """Where the error sits: time, input, output, rate, direction, frequency."""
        return located(self.record, self.residual)

    @property
    def rms(self) -> float:
        """RMS residual, in output units."""
        return float(np.sqrt(np.nanmean(self.residual**2)))

    @property
    def max_abs(self) -> float:
        """Largest residual, in output units."""
        return float(np.nanmax(np.abs(self.residual)))

    @property
    def fit_percent(self) -> float:
        r"""\(100\,(1 - \|e\| / \|z - \bar z\|)\) on the measured rows."""
        output = self.record.output[self.record.measured]
        error = self.residual[self.record.measured]
        return float(100 * (1 - np.linalg.norm(error) / np.linalg.norm(output - output.mean())))

    def to_json(self) -> dict[str, Any]:
        """The content of `comparison.json`."""
        return {
            "record": {"name": self.record.name, "sha256": self.record.sha256},
            "effects": list(self.effects),
            "unit": self.record.output_unit,
            "rms": self.rms,
            "max_abs": self.max_abs,
            "fit_percent": self.fit_percent,
            "percent_of_stroke": 100 * self.rms / self.record.output_range,
            "located": self.located,
            "spikes_left_out": len(self.record.spikes),
            "tests": asdict(self.tests),
        }


def compare(model: Model, record: Record) -> Comparison:
    """Simulate a model along a record and test what it leaves.

    Outputs that stand out alone are left out, such inputs are bridged, and jumps of the output are
    taken back, as `fit` does; `Comparison.notes` tells it.

    Arguments:
        model: the model.
        record: a measured record within the model's range.

    Returns:
        The comparison.

    Raises:
        InputError: if the input leaves the model's range, or an auxiliary column is missing.

    Example:
        >>> import numpy as np, preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> record = pj.Record.from_arrays(t, u, u**1.1)
        >>> compare(pj.fit(record, levels=9).model, record).fit_percent > 98
        True
    """
    record = record.bridged(input_spikes(record)).masked(faults(record))
    simulated = model.predict(record)
    record = record.without(gross_spikes(record))
    record = record.without(isolated_spikes(record, simulated.output))
    record = record.levelled(jumps(record, simulated.output))
    residual = record.output - simulated.output
    longest, step = longest_lag(record), record.step_s
    values = in_sequence(record, residual, longest)
    drive = in_sequence(record, record.input, longest)
    spectrum = cumulated_periodogram(values, step)
    measured = record.measured
    inside = (record.output >= simulated.low) & (record.output <= simulated.high)
    tests = ResidualTests(
        bias=float(np.nanmean(residual)),
        inside_band=float(np.mean(inside[measured])),
        autocorrelation_outside=autocorrelation(values, longest, step).outside,
        cross_correlation_outside=cross_correlation(values, drive, longest, step).outside,
        periodogram_deviation=spectrum.deviation,
        periodogram_band=spectrum.band,
    )
    return Comparison(model, record, simulated, tests)
