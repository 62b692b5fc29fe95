"""A parameter of an effect: its name, unit, bounds and starts, and how a class declares it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from preisach_jax.errors import InputError

OpenEnded = Literal["", "above", "both"]


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: its name, unit, bounds and starts.

    Arguments:
        name: name, with the unit of time in it where it is a time (`tau_s`).
        unit: unit of the value; `"{z}"` and `"{u}"` stand for the record's output and input unit.
        low, high: bounds that the search never leaves.
        start: values from which the search starts; the best of them is refined.
        log: whether the search goes by the logarithm of the value (for times).
        meaning: a few words for the reader.
        amount: whether the effect is absent where the parameter is zero; not so for what is only
            there beside an effect, such as the unknown start of its states.
        open_ended: at which bounds a value is a finding, such as a straight line for a time far
            above the record's: none, `"above"`, or `"both"`; at others an effect is not named.
        total: the amount in which its limit is given, and what one of this parameter adds to it; by
            default the parameter itself.

    Raises:
        InputError: if the bounds are not `low < high`, or a logarithmic one is not positive.

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
    open_ended: OpenEnded = ""
    total: tuple[str, float] = ("", 1.0)

    def __post_init__(self) -> None:
        if not self.total[0]:
            object.__setattr__(self, "total", (self.name, 1.0))
        if not self.low < self.high:
            raise InputError(
                f"parameter {self.name!r} has bounds {self.low} and {self.high}: "
                "the lower one must lie below the upper one"
            )
        if self.log and self.low <= 0:
            raise InputError(
                f"parameter {self.name!r} is searched by its logarithm, but its lower bound is "
                f"{self.low}: give a positive bound, or log=False"
            )

    @property
    def is_amount(self) -> bool:
        """Whether the parameter has a natural zero, at which what it measures vanishes."""
        return self.amount and self.low == 0 and not self.log

    def scale_at(self, value: float) -> float:
        """What a small change of a value is measured by: itself, or the range of the search."""
        if self.log:
            return abs(value)
        return self.high - self.low if math.isfinite(self.high - self.low) else max(abs(value), 1.0)

    def to_search(self, value: float) -> float:
        """The search coordinate of a value: its logarithm where `log` is set."""
        return math.log(value) if self.log else value

    def from_search(self, coordinate: float) -> float:
        """The value of a search coordinate, inside the bounds."""
        value = math.exp(coordinate) if self.log else coordinate
        return min(max(value, self.low), self.high)


def log_grid(low: float, high: float, per_decade: float) -> tuple[float, ...]:
    """Values from `low` to `high`, evenly spaced on a logarithmic scale."""
    count = max(2, round(per_decade * math.log10(high / low)) + 1)
    ratio = (high / low) ** (1 / (count - 1))
    return tuple(low * ratio**i for i in range(count))


def coefficient(name: str, unit: str = "", meaning: str = "", *, amount: bool = True) -> Parameter:
    """A coefficient of any sign that least squares find, as one of `coefficients`.

    Arguments:
        name, unit, meaning, amount: as for `Parameter`; the unit is `"1"` where there is none.

    Raises:
        InputError: if there is no unit.

    Example:
        >>> coefficient("amplitude", "{z}").high
        inf
    """
    if not unit:
        raise InputError(
            f"coefficient({name!r}) has a name and no unit: give both, as in "
            "coefficient('height', '{z}'), with '1' where there is no unit"
        )
    return Parameter(name, unit, -math.inf, math.inf, meaning=meaning, amount=amount)


_DECLARED = "parameter"
"""Key of a declaration in the metadata of a field."""


def parameter(
    unit: str | Callable[[Any], str],
    low: float | Callable[[Any], float],
    high: float | Callable[[Any], float],
    *,
    log: bool = False,
    start: tuple[float, ...] | Callable[[Any], tuple[float, ...]] | None = None,
    margins: tuple[float, float] = (1, 1),
    per_decade: float = 2.0,
    meaning: str | Callable[[Any], str | Sequence[str]] = "",
    amount: bool = True,
    open_ended: OpenEnded = "",
    name: str | None = None,
    when: Callable[[Any], bool] | None = None,
    count: Callable[[Any], int] | None = None,
    total: Callable[[Any], tuple[str, float]] | None = None,
) -> Any:
    """Declare a field of an effect to be a parameter that a search finds.

    Where the effect acts, the field holds the parameter's value; before that it is None.  Whatever
    depends on the record is given as a function of the effect, which `bound_to` has set to it.

    Arguments:
        unit, low, high, log, meaning, amount, open_ended: as for `Parameter`.
        start: values from which the search starts; by default zero, or with `log` a grid.
        margins: factors by which the ends of that grid lie above `low` and below `high`.
        per_decade: starts of that grid in a decade.
        name: the parameter's name where it is not that of the field.
        when: whether the effect has the parameter at all, in one of its forms.
        count: how many parameters there are, `NAME_1` and so on, each with a meaning of its own;
            the field then holds a tuple.
        total: of several, the amount in which the limit of all of them is given, and what one of
            each adds to it; by default the first of them.

    Returns:
        A field of the class, keyword-only, with None by default.

    Example:
        >>> import preisach_jax as pj
        >>> class SensorLag(pj.OutputEffect):
        ...     name = "sensor_lag"
        ...     tau_s: float = parameter("s", 1e-3, 0.1, log=True, per_decade=1)
        >>> [(p.name, p.low, p.high, p.start) for p in SensorLag().parameters()]
        [('tau_s', 0.001, 0.1, (0.001, 0.01, 0.1))]
    """
    declared = Declared(
        unit, low, high, log, start, margins, per_decade, meaning, amount, open_ended, name, when,
        count, total,
    )  # fmt: skip
    return field(default=None, kw_only=True, metadata={_DECLARED: declared})


def time_constant(
    meaning: str | Callable[[Any], str],
    *,
    margins: tuple[float, float],
    per_decade: float = 2.0,
    open_ended: OpenEnded = "",
) -> Any:
    """Declare a time constant, searched by its logarithm from `tau_low_s` to `tau_high_s`."""
    return parameter(
        "s",
        lambda own: own.tau_low_s,
        lambda own: own.tau_high_s,
        log=True,
        margins=margins,
        per_decade=per_decade,
        meaning=meaning,
        open_ended=open_ended,
    )


@dataclass(frozen=True)
class Declared:
    """The arguments of `parameter`; see there."""

    unit: str | Callable[[Any], str]
    low: float | Callable[[Any], float]
    high: float | Callable[[Any], float]
    log: bool
    start: tuple[float, ...] | Callable[[Any], tuple[float, ...]] | None
    margins: tuple[float, float]
    per_decade: float
    meaning: str | Callable[[Any], str | Sequence[str]]
    amount: bool
    open_ended: OpenEnded
    name: str | None
    when: Callable[[Any], bool] | None
    count: Callable[[Any], int] | None
    total: Callable[[Any], tuple[str, float]] | None

    def names(self, effect: Any, own: str) -> list[str]:
        """Names of the parameters that a field of this name holds; none in some forms."""
        name = self.name or own
        if self.when is not None and not self.when(effect):
            return []
        if self.count is None:
            return [name]
        return [f"{name}_{i + 1}" for i in range(self.count(effect))]

    def parameters(self, effect: Any, own: str) -> list[Parameter]:
        """The parameters that a field of this name holds, with their bounds for a record."""
        unit, low, high = (_of(value, effect) for value in (self.unit, self.low, self.high))
        start = _of(self.start, effect)
        if start is None and self.log:
            start = log_grid(low * self.margins[0], high / self.margins[1], self.per_decade)
        meaning = _of(self.meaning, effect)
        meanings = [meaning] if isinstance(meaning, str) else meaning
        total = ("", 1.0) if self.total is None else self.total(effect)
        return [
            Parameter(
                name,
                unit,
                low,
                high,
                (0.0,) if start is None else start,
                self.log,
                own_meaning,
                self.amount,
                self.open_ended,
                total,
            )
            for name, own_meaning in zip(self.names(effect, own), meanings, strict=False)
        ]


def _of(given: Any, effect: Any) -> Any:
    return given(effect) if callable(given) else given


def declared_by(effect_field: Any) -> Declared | None:
    """The declaration of a dataclass field, None if it is no parameter."""
    return effect_field.metadata.get(_DECLARED)
