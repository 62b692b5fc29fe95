"""What an inverse is worth on a course: its tracking error beside that of a straight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.compensation.drive import Compensation, limits_of
from preisach_jax.compensation.past import past_of
from preisach_jax.compensation.search import limited
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import auxiliary_columns
from preisach_jax.model import Model
from preisach_jax.record import Record


@dataclass(frozen=True)
class Tracking:
    """RMS tracking errors to expect on a course, in the unit of the output.

    Attributes:
        compensated: with the drive of the inverse.
        straight: with the affine map that fits that drive best.
        model: held-out error of the model, which both contain.
    """

    compensated: float
    straight: float
    model: float


def tracking(
    model: Model,
    wanted: Record,
    found: Compensation,
    *,
    after: Record | None = None,
    limits: Sequence[float] | None = None,
    slew: float | None = None,
) -> Tracking:
    r"""How well a drive follows its course, and how well a straight line would.

    What the model expects differs from the course by an RMS of \(e\), and the stage from the model
    by its held-out error \(\sigma\): together \(\sqrt{e^2 + \sigma^2}\).  The affine map
    \(u = a + b\,z\) is that which fits the drive of the inverse best, within the same limits.
    """
    rows = slice(-len(found.time), None)
    aux = {name: wanted.aux[name] for name in auxiliary_columns(model.effects)}
    with on_processor():
        past = past_of(model, wanted, after)
        dt = np.diff(past.time, prepend=past.time[0] - past.pause_s)
        line = _fitted(found.wanted, found.drive)
        straight = limited(line, dt, limits_of(model, limits, slew)[0], past.last_input)
        output = replace(model, band=None).predict(past.record(straight, aux)).output[rows]
    own = model.rms_validation
    return Tracking(
        float(np.hypot(_rms(found.expected - found.wanted), own)),
        float(np.hypot(_rms(output - found.wanted), own)),
        own,
    )


def _fitted(wanted: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """The drive as a straight line of the course, by least squares."""
    centred = wanted - wanted.mean()
    power = float(centred @ centred)
    slope = float(centred @ drive) / power if power > 0 else 0.0
    return drive.mean() + slope * centred


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
