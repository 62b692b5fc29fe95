"""A parameter of an effect: its name, unit, bounds and starts, and grids of starts."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """A named, bounded, united parameter of an effect.

    Arguments:
        name: name, with the unit of time in it where it is a time (`tau_s`).
        unit: unit of the value; `"{z}"` and `"{u}"` stand for the record's output and input unit.
        low, high: bounds that the search never leaves.
        start: values from which the search starts; the best of them is refined.
        log: whether the search goes by the logarithm of the value (for times).
        meaning: a few words for the reader.
        amount: whether the effect is absent where the parameter is zero; not so for what is only
            there beside an effect, such as the unknown start of its states.
        open_ended: whether a value at a bound is a finding, such as a straight line for a time far
            above the record's; else an effect that is fitted there is not named.

    Raises:
        ValueError: if the bounds are not `low < high`, or a logarithmic one is not positive.

    Example:
        >>> Parameter("tau_s", "s", low=1e-3, high=1.0, start=(0.01, 0.1), log=True).log
        True
    """

    name: str
    unit: str
    low: float
    high: float
    start: tuple[float, ...] = (0.0,)
    log: bool = False
    meaning: str = ""
    amount: bool = True
    open_ended: bool = False

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(
                f"parameter {self.name!r} has bounds {self.low} and {self.high}: "
                "the lower one must lie below the upper one"
            )
        if self.log and self.low <= 0:
            raise ValueError(
                f"parameter {self.name!r} is searched by its logarithm, but its lower bound is "
                f"{self.low}: give a positive bound, or log=False"
            )

    @property
    def is_amount(self) -> bool:
        """Whether the parameter has a natural zero, at which what it measures vanishes."""
        return self.amount and self.low == 0 and not self.log

    def to_search(self, value: float) -> float:
        """The search coordinate of a value: its logarithm where `log` is set."""
        return math.log(value) if self.log else value

    def from_search(self, coordinate: float) -> float:
        """The value of a search coordinate, inside the bounds."""
        value = math.exp(coordinate) if self.log else coordinate
        return min(max(value, self.low), self.high)


def log_grid(low: float, high: float, per_decade: float) -> tuple[float, ...]:
    """Values from `low` to `high`, evenly spaced on a logarithmic scale.

    Example:
        >>> [round(v, 3) for v in log_grid(0.1, 10.0, per_decade=1)]
        [0.1, 1.0, 10.0]
    """
    count = max(2, round(per_decade * math.log10(high / low)) + 1)
    ratio = (high / low) ** (1 / (count - 1))
    return tuple(low * ratio**i for i in range(count))
