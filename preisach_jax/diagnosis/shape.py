"""The numbers inside terms of a sparse form: time constants, widths and exponents."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Formula = Callable[[float], str]
Values = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Shape:
    """A number inside a term, which may lie between those of the library.

    Attributes:
        value: the number of the library.
        ratio: how far from it the number may be: as far as the next one of the library.
        formula: the term with a number.
        values: (sample, number) the term's values of (number,) numbers.
    """

    value: float
    ratio: float
    formula: Formula
    values: Values

    def times(self, symbol: str, values: np.ndarray, *, bracketed: bool = False) -> Shape:
        """The same, multiplied by a state.

        Arguments:
            values: (sample,) values of the state.
            bracketed: whether the formula stands in brackets behind the symbol.
        """
        before, after = (f"{symbol} · (", ")") if bracketed else (f"{symbol} · ", "")
        return Shape(
            self.value,
            self.ratio,
            lambda number: f"{before}{self.formula(number)}{after}",
            lambda numbers: values[:, None] * self.values(numbers),
        )


def saturating(symbol: str, values: np.ndarray, width: float, ratio: float) -> Shape:
    """tanh(x/w) of a state, (sample,)."""
    return Shape(
        width,
        ratio,
        lambda number: f"tanh({symbol}/{number:.3g})",
        lambda numbers: np.tanh(values[:, None] / numbers),
    )


_ODD = {0.5: "sgn({0}) √|{0}|", 2.0: "{0}|{0}|"}
_EVEN = {1.0: "|{0}|"}


def power(symbol: str, values: np.ndarray, exponent: float, ratio: float, *, odd: bool) -> Shape:
    """|x|^p of a state, (sample,), or sgn(x) |x|^p where it is odd."""
    sign = np.sign(values)[:, None] if odd else 1.0

    def formula(number: float) -> str:
        known = (_ODD if odd else _EVEN).get(number)
        if known:
            return known.format(symbol)
        return f"{f'sgn({symbol}) ' if odd else ''}|{symbol}|^{number:.3g}"

    size = np.abs(values)[:, None]
    return Shape(exponent, ratio, formula, lambda numbers: sign * size**numbers)


def memory(
    symbol: str,
    values: np.ndarray,
    constant: float,
    ratio: float,
    time: np.ndarray,
    starts: np.ndarray,
) -> Shape:
    """First-order low-pass of a state, (sample,), at rest where a record starts.

    Arguments:
        values: (sample,) values of the state.
        time: (sample,) s.
    """
    return Shape(
        constant,
        ratio,
        lambda number: f"low-pass of {symbol} over {number:.3g} s",
        lambda numbers: low_pass(values[:, None], time, numbers, starts)[:, 0],
    )


def low_pass(
    signals: np.ndarray, time: np.ndarray, constants: np.ndarray, starts: np.ndarray
) -> np.ndarray:
    """(sample, signal, constant) first-order low-passes, each at rest where a record starts."""
    keep = np.exp(-np.diff(time, prepend=time[:1])[:, None] / constants)
    keep[starts] = 0.0
    found = np.empty((*signals.shape, len(constants)))
    state = np.repeat(signals[0][:, None], len(constants), axis=1)
    for k, values in enumerate(signals):
        state = values[:, None] + (state - values[:, None]) * keep[k]
        found[k] = state
    return found
