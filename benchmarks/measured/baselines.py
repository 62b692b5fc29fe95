r"""What models without a diagnosis reach on the same held-out rows.

Each gets the inputs (the input and the auxiliary columns) and the outputs of the rows that
identify, and simulates the whole record: it sees the output of the first rows, and no other on the
way.

- **ARX**: a linear difference equation, \( z_k = c + \sum_i a_i z_{k-i} + \sum_{j,i} b_{ji}
  u_{j,k-i} \) (L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, section 4.2), of the
  order of `ORDERS` whose simulation errs least on the last fifth of the identification rows.
- **NARX**: a polynomial of second degree in two past values of each signal, its terms chosen by
  forward orthogonal least squares, of the package SysIdentPy (`pip install --no-deps sysidentpy`:
  0.9 asks for a NumPy older than that of the lock file, and works with this one; left out where it
  is not installed).
- **Prandtl-Ishlinskii**: plays of non-negative weights, an offset and a linear term (M. Brokate and
  J. Sprekels, Hysteresis and Phase Transitions, Springer 1996).
- **velocity**: damped least squares on the input, its velocity and the sign of the velocity, each
  also times every auxiliary column.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from scipy import optimize, signal
from scipy.sparse.linalg import lsqr

ORDERS = (1, 2, 3, 4, 6, 8, 12)
"""Orders of the ARX model that are tried; 12 holds six modes."""

PLAYS = 40
"""Thresholds of the Prandtl-Ishlinskii model, over half the range of the input."""

DAMPING = 1e-3
"""Of the least squares on velocity, with columns of unit RMS."""

TERMS = 20
"""Most terms of the NARX model."""

LAGS = 2
"""Past values of each signal in the NARX model."""

Baseline = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""From times, inputs (time, inputs), output and rows that identify, to the simulated output."""


def arx(_: np.ndarray, inputs: np.ndarray, output: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(time,) simulation by the ARX model of the best order."""
    last = np.flatnonzero(rows)[-(rows.sum() // 5) :]
    early = rows.copy()
    early[last] = False

    def error(order: int) -> float:
        found = _arx_of(order, inputs, output, early)
        return float(np.mean((found[last] - output[last]) ** 2))

    with np.errstate(all="ignore"):
        errors = np.array([error(order) for order in ORDERS])
    best = ORDERS[int(np.argmin(np.where(np.isfinite(errors), errors, np.inf)))]
    return _arx_of(best, inputs, output, rows)


def _arx_of(order: int, inputs: np.ndarray, output: np.ndarray, rows: np.ndarray) -> np.ndarray:
    past = np.lib.stride_tricks.sliding_window_view
    used = np.asarray(past(rows, order + 1).all(axis=1))
    outputs = past(output, order + 1)[:, ::-1]
    windows = past(inputs, order + 1, axis=0)[:, :, ::-1].reshape(len(used), -1)
    columns = np.column_stack([outputs[:, 1:], windows, np.ones(len(used))])
    found = np.linalg.lstsq(columns[used], outputs[used, 0], rcond=1e-12)[0]
    a, b, constant = found[:order], found[order:-1].reshape(inputs.shape[1], -1), found[-1]
    driven = constant + sum(
        np.convolve(inputs[:, j], b[j])[: len(inputs)] for j in range(inputs.shape[1])
    )
    first = int(np.flatnonzero(used)[0]) + order
    recursion = np.r_[1.0, -a]
    state = signal.lfiltic([1.0], recursion, output[first - 1 :: -1][:order])
    simulated = signal.lfilter([1.0], recursion, driven[first:], zi=state)[0]
    return np.r_[output[:first], simulated]


def narx(_: np.ndarray, inputs: np.ndarray, output: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(time,) simulation by the NARX model.

    The stretches that identify are joined; the few rows behind a joint mix two stretches.
    """
    from sysidentpy.basis_function import Polynomial  # pyright: ignore[reportMissingImports]
    from sysidentpy.model_structure_selection import FROLS  # pyright: ignore[reportMissingImports]
    from sysidentpy.parameter_estimation import LeastSquares  # pyright: ignore[reportMissingImports]

    centre, scale = inputs[rows].mean(axis=0), np.ptp(inputs[rows], axis=0) / 2
    zero, range_ = output[rows].mean(), np.ptp(output[rows]) / 2
    u = (inputs - centre) / np.where(scale > 0, scale, 1.0)
    lags = list(range(1, LAGS + 1))
    model = FROLS(
        ylag=LAGS,
        xlag=[lags] * inputs.shape[1] if inputs.shape[1] > 1 else LAGS,
        n_info_values=TERMS,
        info_criteria="bic",
        estimator=LeastSquares(),
        basis_function=Polynomial(degree=2),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X=u[rows], y=((output[rows] - zero) / range_)[:, None])
        first = int(np.flatnonzero(rows)[0])
        start = (output[first : first + LAGS] - zero) / range_
        simulated = model.predict(X=u[first:], y=start[:, None])[:, 0]
    return np.r_[output[:first], zero + range_ * simulated]


def prandtl_ishlinskii(
    _: np.ndarray, inputs: np.ndarray, output: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """(time,) output of the play operators."""
    x = inputs[:, 0]
    thresholds = np.arange(PLAYS) / PLAYS * np.ptp(x) / 2
    plays = np.empty((len(x), PLAYS))
    plays[0] = x[0]
    for k in range(1, len(x)):
        plays[k] = np.maximum(x[k] - thresholds, np.minimum(x[k] + thresholds, plays[k - 1]))
    columns = np.column_stack([plays - x.mean(), np.ones(len(x)), -np.ones(len(x))])
    side = np.sign(np.corrcoef(x[rows], output[rows])[0, 1])
    weights, _norm = optimize.nnls(columns[rows], side * output[rows])
    return side * (columns @ weights)


def velocity(
    time: np.ndarray, inputs: np.ndarray, output: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """(time,) output of a spring, a damper and dry friction, scaled by the columns."""
    x = inputs[:, 0]
    v = np.gradient(x, time)
    dry = np.tanh(v / (0.1 * np.sqrt(np.mean(v**2))))
    own = [x, v, dry]
    own += [column * each for column in inputs[:, 1:].T for each in (np.ones(len(x)), x, v, dry)]
    columns = np.column_stack(own)
    columns = columns / np.sqrt(np.mean(columns[rows] ** 2, axis=0))
    columns = np.column_stack([columns, np.ones(len(x))])
    damp = DAMPING * np.sqrt(rows.sum())
    return columns @ lsqr(columns[rows], output[rows], damp=damp, atol=1e-12, btol=1e-12)[0]


BASELINES: dict[str, Baseline] = {
    "ARX": arx,
    "NARX": narx,
    "Prandtl-Ishlinskii": prandtl_ishlinskii,
    "velocity": velocity,
}
