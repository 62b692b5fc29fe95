"""The score of a model against a simpler one, from how well each predicts what it has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial

import jax.numpy as jnp
import numpy as np

from preisach_jax.chain.signals import each_run
from preisach_jax.effects.base import OfColumn, Signals
from preisach_jax.fit import Fit
from preisach_jax.identify.problem import ALL, VALIDATION, Point, Problem, evaluate, solved

STRETCHES = 24
"""Stretches of equal numbers of rows over which predictions are compared: few enough that what is
left of one says little of the next."""

OF_THE_LAW = 0.03
"""Deviation of the mean logarithm of an RMS error that no number of rows makes smaller: cells of
the plane, and laws that are not quite the machine's, make the errors of any two models differ by
some per cent."""

LEAST_SCORE = 3.0
"""Score below which nothing is named.  In 14 development records that hide nothing no effect has
more than 1.7, but for a line that the drive makes, which lowers no held-out error; hidden effects
that are seen have 6 and more."""


@dataclass(frozen=True)
class Evidence:
    r"""What speaks for a model against another.

    \[ s = \frac{\bar r}{\sqrt{\operatorname{var}(r)/n + \sigma_0^2}}, \qquad
    r_b = \tfrac12 \log \frac{m_b + f}{m'_b + f} \]

    with the mean squares \(m_b\) and \(m'_b\) that the simple model and the rich one leave in the
    stretch b of n, each predicted from others, the mean square f that does not matter, and
    `OF_THE_LAW` for \(\sigma_0\).

    Attributes:
        gain: relative fall of the held-out mean square.
        score: s.
        blocks: n.
    """

    gain: float
    score: float
    blocks: int

    @staticmethod
    def of(simple: np.ndarray, rich: np.ndarray, gain: float, floor: float = 0.0) -> Evidence:
        """The evidence of `(stretch,)` mean squares.

        Arguments:
            floor: mean square that does not matter.
        """
        # Where readings have steps, a stretch may be predicted without any error.
        least = floor + np.finfo(float).eps ** 2 * max(float(np.max(simple, initial=0.0)), 1e-200)
        r = 0.5 * np.log((simple + least) / (rich + least))
        scatter = r.var(ddof=1) / len(r) if len(r) > 1 else np.inf
        return Evidence(gain, float(r.mean() / np.sqrt(scatter + OF_THE_LAW**2)), len(r))

    @property
    def against(self) -> str:
        """Why it is too little for a name; empty if it is enough."""
        # Written so that numbers that are not finite are too little.
        if not self.gain > 0:
            return "the held-out error does not fall"
        if not self.score >= LEAST_SCORE:
            return (
                f"its score over {self.blocks} stretches is {self.score:.1f}, below "
                f"{LEAST_SCORE:.0f}"
            )
        return ""

    def numbers(self) -> dict[str, float]:
        """The evidence as plain numbers."""
        return asdict(self)


def predicted_errors(problem: Problem, point: Point) -> np.ndarray:
    """(stretch,) mean squares of a model, each fold of rows predicted from the others.

    Where whole runs are held out, only these are predicted.
    """
    folds = ALL if len(problem.identified) == len(ALL) else VALIDATION
    error = np.zeros(len(problem.rows))
    for fold in folds:
        rows = problem.fold == fold
        error[rows] = solved(replace(point, folds=ALL[fold != ALL])).residual[rows]
    return _by_stretch(error[problem.in_time][np.isin(problem.fold[problem.in_time], folds)])


def compare(problem: Problem, simple: Point, rich: Point, floor: float = 0.0) -> Evidence:
    """Evidence for one model of a record against another.

    Arguments:
        floor: mean square, in squared output ranges, that does not matter.
    """
    before, after = predicted_errors(problem, simple), predicted_errors(problem, rich)
    return Evidence.of(before, after, gain_of(simple, rich, floor), floor)


def gain_of(simple: Point, rich: Point, floor: float = 0.0) -> float:
    """Relative fall of the held-out mean square from one model to another, down to a floor."""
    before, after = (max(p.validation_mean_square, floor) for p in (simple, rich))
    return 1 - simple_ratio(after, before)


def compare_fits(simple: Fit, rich: Fit) -> Evidence:
    """Evidence for one fit of a single record against another, from the rows held out."""
    before, after = (_by_stretch(fit.residual[rich.validation]) for fit in (simple, rich))
    gain = 1 - simple_ratio(rich.rms_validation**2, simple.rms_validation**2)
    return Evidence.of(before, after, gain)


def evidence_between(problem: Problem, before: np.ndarray, after: np.ndarray) -> Evidence:
    """Evidence for a change of a model, from the `(row,)` residuals without and with it."""
    held_out = problem.in_time[problem.fold[problem.in_time] == VALIDATION[0]]
    left, right = before[held_out], after[held_out]
    gain = 1 - simple_ratio(float(np.mean(right**2)), float(np.mean(left**2)))
    return Evidence.of(_by_stretch(left), _by_stretch(right), gain)


def _by_stretch(error: np.ndarray) -> np.ndarray:
    parts = np.array_split(error, STRETCHES)
    return np.array([np.mean(part**2) for part in parts if len(part)])


def simple_ratio(part: float, whole: float) -> float:
    """A ratio that is one where the whole vanishes."""
    return part / whole if whole > 0 else 1.0


SHIFTS = 10
"""Parts of a record by which a column is shifted, forward in time and backward: with the column
backward and not shifted there are 19 other courses, and one in twenty columns that have nothing to
do with the output leads them all."""


def by_chance(problem: Problem, point: Point, name: str) -> str:
    """What says that a column goes with a wander by chance; empty if nothing does.

    Signals that wander at random go together for as long as a record is short, and rows between
    those that identify tell nothing of it.  So the column is shifted in time, which leaves its
    spectrum as it is: where it does no more than a shifted one, it says nothing.
    """
    effect = point.chain.effect(name)
    if not (
        isinstance(effect, OfColumn) and any(each.nonparametric for each in point.chain.effects)
    ):
        return ""
    for signals in _shifted(problem.signals, effect.column):
        other = replace(problem, signals=signals)
        there = evaluate(other, point.chain, point.values, point.strength, point)
        if there.objective <= point.objective:
            return (
                f"{effect.column} shifted in time explains as much of what wanders: that they go "
                "together is chance"
            )
    return ""


def _shifted(signals: Signals, column: str) -> Iterator[Signals]:
    """Signals with a column shifted in time within each run, and backward."""
    for part in range(SHIFTS):
        for direction in (1, -1):
            if part or direction < 0:
                yield each_run(partial(_turned, column, part / SHIFTS, direction), signals)


def _turned(column: str, share: float, direction: int, signals: Signals) -> Signals:
    """The signals of a run with a column that goes in a direction from a share of the run on."""
    course = np.asarray(signals.aux[column])
    turned = np.roll(course[::direction], round(share * len(course)))
    return replace(signals, aux={**signals.aux, column: jnp.asarray(turned)})
