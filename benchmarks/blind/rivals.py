"""Simpler ways to name an effect, judged on the same records, to show what both tests are for.

The first two see the joint refits of the effects that were worth fitting, the third one sees the
residual of the model without effects:

- `criterion`: the first test alone, the greatest fall of the Bayesian information criterion on
  whitened residuals, if it is 10 or more;
- `held_out`: the second test without its threshold, the greatest fall of the held-out error, if it
  falls at all;
- `correlation`: the effect whose simple sign correlates most with the residual, if the ordinary
  information criterion, which takes samples as independent, prefers a term for it.
"""

from __future__ import annotations

import numpy as np
from scipy import signal

import preisach_jax as pj
from blind.results import RIVALS

LEAST_FALL = 10.0
SLOW = 0.05  # part of the record over which the sign of creep forgets


def rival_names(found: pj.Diagnosis, library: list[str]) -> dict[str, str | None]:
    """The effect that each simpler way names first, None where it names nothing.

    Arguments:
        found: a diagnosis with its candidates.
        library: names of the effects that there are.

    Returns:
        Names by rival.
    """
    first = [trial for trial in found.candidates if trial.step == 0 and "z" in trial.evidence]
    criterion = {trial.effect: trial.evidence["delta_bic"] for trial in first}
    gain = {trial.effect: trial.gain for trial in first}
    names = (
        _greatest(criterion, LEAST_FALL),
        _greatest(gain, 0.0),
        _greatest(_correlated(found, library), 0.0),
    )
    return dict(zip(RIVALS, names, strict=True))


def _greatest(score: dict[str, float], least: float) -> str | None:
    name = max(score, key=lambda key: score[key], default=None)
    return name if name is not None and score[name] > least else None


def _correlated(found: pj.Diagnosis, library: list[str]) -> dict[str, float]:
    """Fall of the ordinary criterion for one more term, by the effect that the term stands for."""
    record = found.base.record
    there = record.measured
    residual = found.base.residual[there] - found.base.residual[there].mean()
    falls = {}
    for name, sign in simple_signs(record).items():
        if name in library or name.startswith("aux:"):
            column = sign[there] - sign[there].mean()
            power = (column @ column) * (residual @ residual)
            share = (column @ residual) ** 2 / power if power > 0 else 0.0
            falls[name] = -len(residual) * np.log1p(-share) - np.log(len(residual))
    return falls


def simple_signs(record: pj.Record) -> dict[str, np.ndarray]:
    """(time,) what a residual looks like at first order, by the effect that it would betray.

    Arguments:
        record: the measurement.

    Returns:
        Columns without a scale.
    """
    t, u = record.time, record.input
    z = np.where(record.measured, record.output, np.mean(record.output[record.measured]))
    centred = z - z.mean()
    rate = np.gradient(u, t)
    keep = float(np.exp(-record.step_s / (SLOW * record.duration_s)))
    slow = signal.lfilter([1 - keep], [1, -keep], centred)
    columns = {
        "drift": t,
        "input_lag": rate,
        "ageing": t * centred,
        "creep": centred - slow,
        "output_nonlinearity": centred**2,
        "rate_dependence": np.sign(rate) * np.sqrt(np.abs(rate)),
        "hum": np.sin(2 * np.pi * 50.0 * t),
    }
    return columns | {f"aux:{name}": values for name, values in record.aux.items()}
