"""Simpler ways to name an effect, judged on the same records, to show what the score is for.

The first three see the joint refits of the effects, the others the residual of the model without
effects:

- `forward`: forward selection by the ordinary information criterion, which takes samples as
  independent, on the held-out error;
- `effective`: the same with as many samples as there would be of independent ones, by the
  correlation of neighbours in the residual (G. V. Bayley, J. M. Hammersley, J. R. Stat. Soc.
  Suppl. 8 (1946) 184-197);
- `held_out`: the greatest fall of the held-out error, if it falls at all;
- `correlation`: the effect whose simple sign correlates most with the residual, if the ordinary
  information criterion prefers a term for it;
- `sparse`: the greatest term of a sparse regression of the residual on the simple signs of all
  effects, by thresholded least squares (S. L. Brunton, J. L. Proctor, J. N. Kutz, PNAS 113 (2016)
  3932-3937).
"""

from __future__ import annotations

import numpy as np
from scipy import signal

import preisach_jax as pj
from blind.rates import RIVALS

TERMS = 2  # of an effect, for the ordinary criterion
LEAST_TERM = 0.1  # of a sparse regression, in parts of the residual
SLOW = 0.05  # part of the record over which the sign of creep forgets


def rival_names(found: pj.Diagnosis) -> dict[str, str | None]:
    """The effect that each simpler way names first, None where it names nothing."""
    library = list(pj.effects())
    first = [trial for trial in found.candidates if trial.step == 0 and "score" in trial.evidence]
    gain = {trial.effect: trial.gain for trial in first}
    rows = int(np.count_nonzero(found.base.record.measured))
    signs, residual = _signs_and_residual(found, library)
    alike = min(max(float(residual[1:] @ residual[:-1] / (residual @ residual)), 0.0), 0.9999)
    names = (
        _greatest(_criterion(gain, rows), 0.0),
        _greatest(_criterion(gain, rows * (1 - alike) / (1 + alike)), 0.0),
        _greatest(gain, 0.0),
        _greatest(_correlated(signs, residual), 0.0),
        _greatest(_sparse(signs, residual), 0.0),
    )
    return dict(zip(RIVALS, names, strict=True))


def _criterion(gain: dict[str, float], rows: float) -> dict[str, float]:
    """Fall of the ordinary criterion for each effect by its fall of the held-out mean square."""
    penalty = TERMS * np.log(rows)
    return {name: -rows * np.log1p(-min(fall, 0.999)) - penalty for name, fall in gain.items()}


def _greatest(score: dict[str, float], least: float) -> str | None:
    name = max(score, key=lambda key: score[key], default=None)
    return name if name is not None and score[name] > least else None


def _signs_and_residual(
    found: pj.Diagnosis, library: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """(row,) signs of the library's effects, of RMS 1 or 0, and the residual, without means."""
    record = found.base.record
    there = record.measured
    signs = {}
    for name, sign in simple_signs(record).items():
        if name in library or name.startswith("aux:"):
            column = sign[there] - sign[there].mean()
            signs[name] = column / (column.std() or 1.0)
    return signs, found.base.residual[there] - found.base.residual[there].mean()


def _correlated(signs: dict[str, np.ndarray], residual: np.ndarray) -> dict[str, float]:
    """Fall of the ordinary criterion for one more term, by the effect that the term stands for."""
    rows, power = len(residual), residual @ residual
    share = {name: (sign @ residual) ** 2 / (rows * power) for name, sign in signs.items()}
    return {name: -rows * np.log1p(-part) - np.log(rows) for name, part in share.items()}


def _sparse(signs: dict[str, np.ndarray], residual: np.ndarray) -> dict[str, float]:
    """Size of each term that a sparse regression keeps, in parts of the residual."""
    kept = list(signs)
    while kept:
        columns = np.stack([signs[name] for name in kept], axis=1)
        size = np.abs(np.linalg.lstsq(columns, residual)[0]) / residual.std()
        small = size < LEAST_TERM
        if not small.any():
            return dict(zip(kept, size.tolist(), strict=True))
        kept = [name for name, out in zip(kept, small, strict=True) if not out]
    return {}


def simple_signs(record: pj.Record) -> dict[str, np.ndarray]:
    """(time,) what a residual looks like at first order, by the effect that it would betray."""
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
