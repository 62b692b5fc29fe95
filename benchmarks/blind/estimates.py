"""Parameters of effects that were named rightly, against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

STATED = 95.0
"""Percentage of the intervals that a diagnosis states."""

LEVELS = (50.0, 68.0, 80.0, 90.0, STATED, 99.0)
"""Percentages of the intervals whose coverage is counted."""

PRESENT_SINCE = "2026-11-27T06:03"
"""When intervals were last made longer, by what records that were finished before had shown."""


@dataclass(frozen=True)
class Estimate:
    """A parameter that the diagnosis and the truth both have.

    Attributes:
        effect, name: of the effect and of the parameter.
        true, value, low, high: the truth, the estimate, and its stated interval.
        present: whether the interval is as long as they are made now.
    """

    effect: str
    name: str
    true: float
    value: float
    low: float
    high: float
    present: bool = True

    @property
    def relative_error(self) -> float:
        """Distance from the truth over the truth."""
        return abs(self.value - self.true) / abs(self.true)


def estimates_of(results: Sequence[dict[str, Any]]) -> list[Estimate]:
    """All parameters of hidden effects that were named, alone or beside others.

    Arguments:
        results: finished cases.
    """
    found: list[Estimate] = []
    for one in results:
        present = is_present(one)
        for effect, truth in one["truth"].items():
            said = one["parameters"].get(effect, {})
            for name in sorted(set(truth) & set(said)):
                true, row = truth[name], said[name]
                if true and np.isfinite(true):
                    found.append(
                        Estimate(effect, name, true, row["value"], row["low"], row["high"], present)
                    )
    return found


def is_present(result: dict[str, Any]) -> bool:
    """Whether a case was finished since intervals are as long as they are made now."""
    return result["finished"] >= PRESENT_SINCE


def covers(estimate: Estimate, level: float = STATED) -> bool:
    """Whether an interval has the truth, widened or narrowed on both sides as a normal one is.

    Arguments:
        estimate: the parameter, with its stated interval.
        level: percentage of the interval that is asked.

    Example:
        >>> covers(Estimate("drift", "amplitude", 1.0, 1.1, 0.9, 1.3)), covers(
        ...     Estimate("drift", "amplitude", 1.0, 1.1, 0.9, 1.3), 50.0
        ... )
        (True, False)
    """
    true, value = estimate.true, estimate.value
    side = estimate.high - value if true > value else value - estimate.low
    asked, stated = (float(stats.norm.ppf(0.5 + each / 200)) for each in (level, STATED))
    return abs(true - value) <= side * (asked / stated)
