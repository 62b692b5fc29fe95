"""The two tests before an effect is named: held-out blocks, and a whitened criterion."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from preisach_jax.fit import Fit
from preisach_jax.identify import VALIDATION, Point, Problem
from preisach_jax.identify.signature import Prospect, amounts_of

LEAST_GAIN = 0.05
"""Relative fall of the held-out mean square below which nothing is named."""

LEAST_Z = 3.0
"""Standardised mean gain over the held-out blocks below which nothing is named."""

GREAT_GAIN = 0.25
"""Relative fall of the held-out mean square from which on a smaller z is enough: what makes so much
of the error is seldom spread evenly over the record."""

LEAST_Z_OF_GREAT_GAIN = 2.0

LEAST_DELTA_BIC = 10.0
"""Fall of the whitened criterion below which nothing is named."""

AR_ORDER = 20


@dataclass(frozen=True)
class Evidence:
    """What speaks for a model against another.

    Attributes:
        gain: relative fall of the held-out mean square.
        z: mean over its standard error of the paired gains of the held-out blocks, the greater of
            that of mean squares and that of their logarithms.
        blocks: number of held-out blocks.
        delta_bic: fall of the Bayesian information criterion on whitened residuals.
    """

    gain: float
    z: float
    blocks: int
    delta_bic: float

    @property
    def least_z(self) -> float:
        """The z below which nothing is named."""
        return LEAST_Z_OF_GREAT_GAIN if self.gain >= GREAT_GAIN else LEAST_Z

    @property
    def against(self) -> str:
        """Why a test is not passed; empty if both are."""
        reasons: list[str] = []
        # Written so that numbers that are not finite pass no test.
        if not self.gain >= LEAST_GAIN:
            reasons.append(
                f"the held-out mean square falls by {100 * self.gain:.1f} %, less than "
                f"{100 * LEAST_GAIN:.0f} %"
                if self.gain > 0
                else "the held-out error does not fall"
            )
        elif not self.z >= self.least_z:
            reasons.append(
                f"the gain varies too much over the {self.blocks} held-out blocks "
                f"(z = {self.z:.1f}, below {self.least_z:.0f})"
            )
        if not self.delta_bic >= LEAST_DELTA_BIC:
            reasons.append(
                "the whitened residual does not decrease enough for the parameters added "
                f"(ΔBIC = {self.delta_bic:.0f}, below {LEAST_DELTA_BIC:.0f})"
            )
        return "; ".join(reasons)

    def numbers(self) -> dict[str, float]:
        """The evidence as plain numbers."""
        return asdict(self)


def residual_in_time(problem: Problem, point: Point) -> np.ndarray:
    """(row,) residual of a point over all measured rows in time order, in output ranges."""
    return point.residual[problem.in_time]


def innovation_variance(
    residual: np.ndarray, order: int = AR_ORDER, breaks: tuple[int, ...] = ()
) -> float:
    """Variance of what an autoregression cannot predict of a residual.

    Least squares on lagged values (P. J. Brockwell, R. A. Davis, Time Series: Theory and Methods,
    2nd ed., Springer 1991, ch. 8).

    Arguments:
        residual: (row,) residual in time order.
    """
    if breaks:
        parts = np.split(residual, breaks)
        powers = [innovation_variance(part, order) * len(part) for part in parts if len(part)]
        return sum(powers) / len(residual)
    order = min(order, len(residual) // 10)
    if order < 1:
        return max(float(np.mean(residual**2)), np.finfo(float).tiny)
    goal = residual[order:]
    lagged = np.stack([residual[order - k : -k] for k in range(1, order + 1)], axis=1)
    solution = np.linalg.lstsq(lagged, goal, rcond=None)[0]
    return max(float(np.mean((goal - lagged @ solution) ** 2)), np.finfo(float).tiny)


def free_parameters(point: Point) -> int:
    """Number of parameters that the effects of a point spend; amounts of zero spend none."""
    spent = len(point.columns.added) + len(point.columns.own)
    for effect, parameter in point.parameters:
        spent += not (parameter.is_amount and point.values[effect][parameter.name] == 0)
    return spent


def block_mean_squares(problem: Problem, residual: np.ndarray) -> np.ndarray:
    """(block,) mean square of a residual in time order over each held-out block."""
    block = problem.block[problem.in_time]
    held_out = np.unique(block[problem.fold[problem.in_time] == VALIDATION[0]])
    return np.array([np.mean(residual[block == one] ** 2) for one in held_out])


def compare(problem: Problem, simple: Point, rich: Point) -> Evidence:
    """Evidence for one model against another that is held to be simpler."""
    residuals = (residual_in_time(problem, simple), residual_in_time(problem, rich))
    spent = free_parameters(rich) - free_parameters(simple)
    gain = 1 - simple_ratio(rich.validation_mean_square, simple.validation_mean_square)
    return _evidence(problem, *residuals, gain, spent)


def compare_fits(simple: Fit, rich: Fit) -> Evidence:
    """Evidence for one fit of a single record against another, from what both leave of all rows."""
    measured, held_out = rich.record.measured, rich.validation
    starts = np.cumsum(np.diff(held_out.astype(int), prepend=0) == 1)[held_out]

    def squares(fit: Fit) -> np.ndarray:
        sums = np.bincount(starts, fit.residual[held_out] ** 2)[1:]
        return np.asarray(sums / np.bincount(starts)[1:])

    gain = 1 - simple_ratio(rich.rms_validation**2, simple.rms_validation**2)
    spent = sum(len(effect.parameters()) for effect in rich.model.effects)
    spent += int(np.count_nonzero(rich.model.weights)) if rich.model.chain.mechanics else 0
    return _evidence_of(
        simple.residual[measured],
        rich.residual[measured],
        squares(simple),
        squares(rich),
        gain,
        spent,
    )


def promised_evidence(problem: Problem, simple: Point, prospect: Prospect) -> Evidence:
    """Evidence for an effect beside a model as it is promised to first order."""
    before = residual_in_time(problem, simple)
    after = prospect.promise.residual[problem.in_time]
    spent = len(prospect.effect.parameters()) + len(amounts_of(prospect.effect))
    return _evidence(problem, before, after, prospect.held_out, spent)


def evidence_between(
    problem: Problem, before: np.ndarray, after: np.ndarray, spent: int
) -> Evidence:
    """Evidence for a change of a model, from the residuals without and with it.

    Arguments:
        before, after: (row,) residuals in the order of the problem's rows.
    """
    held_out = problem.fold == VALIDATION[0]
    left, right = (float(np.mean(e[held_out] ** 2)) for e in (before, after))
    order = problem.in_time
    return _evidence(problem, before[order], after[order], 1 - simple_ratio(right, left), spent)


def _evidence(
    problem: Problem, before: np.ndarray, after: np.ndarray, gain: float, spent: int
) -> Evidence:
    squares = (block_mean_squares(problem, before), block_mean_squares(problem, after))
    return _evidence_of(before, after, *squares, gain, spent, problem.breaks)


def _evidence_of(
    before: np.ndarray,
    after: np.ndarray,
    squares_before: np.ndarray,
    squares_after: np.ndarray,
    gain: float,
    spent: int,
    breaks: tuple[int, ...] = (),
) -> Evidence:
    """Evidence from residuals in time order, and their mean squares over the held-out blocks."""
    count = len(before)
    whitened = [innovation_variance(e, breaks=breaks) for e in (before, after)]
    ratio = whitened[0] / whitened[1]
    return Evidence(
        gain=gain,
        z=max(
            standardised(squares_before - squares_after),
            standardised(_log(squares_before) - _log(squares_after)),
        ),
        blocks=len(squares_before),
        delta_bic=float(count * np.log(ratio) - spent * np.log(count)),
    )


def _log(squares: np.ndarray) -> np.ndarray:
    # Where the readings have steps, a block may be predicted without any error.
    return np.log(np.maximum(squares, np.finfo(float).tiny))


def simple_ratio(part: float, whole: float) -> float:
    """A ratio that is one where the whole vanishes."""
    return part / whole if whole > 0 else 1.0


def standardised(values: np.ndarray) -> float:
    """Mean of some values over its standard error; zero if they do not vary."""
    error = np.std(values, ddof=1) / np.sqrt(len(values))
    return float(np.mean(values) / error) if error > 0 else 0.0
