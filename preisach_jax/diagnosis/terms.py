"""The terms that a sparse form is searched among: functions of the states at hand."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from preisach_jax.diagnosis.form import State
from preisach_jax.diagnosis.remainder import OF_COLUMN, PHYSICS
from preisach_jax.record.core import Record
from preisach_jax.record.course import input_rate, last_move, last_reversal

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


MEMORIES = 6
"""Time constants of first-order memories, from some samples to a part of the record."""

WIDTHS = (0.03, 0.1, 0.3)
"""Widths of saturating functions, in parts of the scale of a state."""

NEXT_WIDTH, NEXT_EXPONENT = 3.3, 2.0
"""How far a width and an exponent may be from that of the library, as a ratio."""

QUANTILE = 0.98
"""Quantile of the magnitude of a rate that is its scale."""

ORDERS = {"plain": 1, "square": 2, "product": 2, "cube": 3, "saturating": 3, "memory": 4,
          "bent product": 4, "memory product": 5}  # fmt: skip
"""Of how many numbers and factors each kind of term is: of terms alike the least is taken."""

BY_KIND = {
    "position": PHYSICS["input"],
    "output": PHYSICS["output"],
    "rate": "viscous friction, eddy currents, a voltage that motion induces, a lag or a delay",
    "acceleration": "inertia, a resonance, or a filter of second order",
    "direction": PHYSICS["direction of the input"],
    "path": PHYSICS["path since the last reversal"],
    "age": PHYSICS["time since the last reversal"],
    "time": PHYSICS["time"],
    "turn": PHYSICS["input at the last reversal"],
    "column": OF_COLUMN,
}
"""What kind of physics makes a term of one state."""

BY_PAIR = {
    frozenset({"position", "rate"}): "damping, a lag or an induced voltage that changes with the "
    "position",
    frozenset({"output", "rate"}): "damping or eddy currents that change with the output",
    frozenset({"position", "output"}): "a gain that changes with the position, or feedback of the "
    "output",
    frozenset({"position", "direction"}): "a loop whose width changes with the position, as dry "
    "friction under a changing load",
    frozenset({"output", "direction"}): "dry friction that grows with the force",
    frozenset({"position", "time"}): "a gain that changes as time goes by: ageing, warming",
    frozenset({"output", "time"}): "a gain that changes as time goes by: ageing, warming",
    frozenset({"rate", "time"}): "a damping that changes as time goes by: warming of an oil",
    frozenset({"direction", "rate"}): "friction that grows faster or slower than the speed",
}
"""What kind of physics makes the product of two states."""

OF_COLUMN_PRODUCT = "the column scales the loop, or changes its damping"

OF_MEMORY = "creep, a lag or a relaxation; of a speed or its square, warming by the drive's losses"

OF_MEMORY_PRODUCT = "a gain that follows the past: warming by losses, fatigue that heals"


@dataclass(frozen=True, eq=False)
class Along:
    """A state, its kind, and its standardised values along the samples."""

    state: State
    kind: str
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Listed:
    """A term of the library.

    Attributes:
        formula, physics, states: as those of a `Term`.
        order: how many numbers and factors it is made of.
        values: (sample,) its values.
        along: (sample,) those of its state, if it is a function of one at the same sample.
        shape: the number inside it; None if there is none.
        numbers: how many numbers inside it are found from the record.
    """

    formula: str
    physics: str
    states: tuple[State, ...]
    order: int
    values: np.ndarray
    along: np.ndarray | None = None
    shape: Shape | None = None
    numbers: int = 0

    def shaped(self, shape: Shape, number: float) -> Listed:
        """The same term with another number inside it."""
        values = shape.values(np.array([number]))[:, 0]
        return replace(self, formula=shape.formula(number), values=values, shape=None, numbers=1)


@dataclass(frozen=True, eq=False)
class Library:
    """All terms along the samples of a record.

    Attributes:
        terms: the terms.
        notes: what could not be made terms of.
    """

    terms: list[Listed] = field(default_factory=list[Listed])
    notes: list[str] = field(default_factory=list[str])

    def add(
        self,
        formula: str,
        physics: str,
        order: int,
        values: np.ndarray,
        *of: Along,
        shape: Shape | None = None,
    ) -> None:
        """Take up a term, unless it does not vary or is not finite."""
        past = "low-pass" in formula
        if np.isfinite(values).all() and np.ptp(values) > 1e-9 * (np.abs(values).max() or 1.0):
            states = tuple(dict.fromkeys(each.state for each in of))
            # What the model says of the output holds a part of whatever it lacks.
            order += any("output" in each.kind for each in of)
            alone = of[0].values if len(of) == 1 and not past else None
            self.terms.append(Listed(formula, physics, states, order, values, alone, shape))

    def add_shaped(self, shape: Shape, physics: str, order: int, *of: Along) -> None:
        """Take up a term with a number inside it."""
        values = shape.values(np.array([shape.value]))[:, 0]
        self.add(shape.formula(shape.value), physics, order, values, *of, shape=shape)


def library_of(record: Record, output: np.ndarray, kept: np.ndarray) -> Library:
    """The terms of a record and of what a model says of it.

    Arguments:
        output: (time,) output of the model, in output units.
        kept: (sample,) rows at which the terms are wanted, ascending.
    """
    found = Library()
    states = {each.kind: each for each in states_of(record, output, kept)}
    columns = columns_of(record, kept, found.notes)
    speed = _speed(states)
    for each in (*states.values(), *columns):
        _alone(found, each)
    _products(found, states, columns, speed)
    starts = np.searchsorted(kept, record.starts)
    _memories(found, states, columns, speed, record.time[kept], starts)
    return found


OF_RATES = ("rate", "rate of output", "acceleration")
"""States that a record without a clock does not have."""


def states_of(record: Record, output: np.ndarray, kept: np.ndarray) -> list[Along]:
    """The states of a record, but its columns; those that do not vary are left out."""
    last, time = last_reversal(record.input, None, record.starts), record.time
    rate = input_rate(time, record.input, record.starts)
    of_output = input_rate(time, output, record.starts)
    second = input_rate(time, rate, record.starts)
    since, way = time - time[last], np.abs(record.input - record.input[last])
    u, z = record.input_unit, record.output_unit
    centred, signed, counted = "centred", "signed", "counted"
    rows = [
        ("position", "input", "u", u, record.input, centred),
        ("output", "output of the model", "h", z, output, centred),
        ("rate", "rate of the input", "u'", f"{u}/s" if u else "1/s", rate, signed),
        ("rate of output", "rate of the model's output", "h'", f"{z}/s" if z else "1/s",
         of_output, signed),
        ("acceleration", "second derivative of the input", "u''", f"{u}/s²" if u else "1/s²",
         second, signed),
        ("direction", "direction of the last move", "d", "", last_move(record.input), counted),
        ("path", "path since the last reversal", "s", u, way, "scaled"),
        ("age", "logarithm of the time since the last reversal, in samples", "a", "",
         np.log10(1 + since / record.step_s), counted),
        ("time", "time", "t", record.time_unit, time, centred),
        ("turn", "input at the last reversal", "u_r", u, record.input[last], centred),
    ]  # fmt: skip
    if not record.has_clock:
        rows = [row for row in rows if row[0] not in OF_RATES]
    found: list[Along] = []
    for kind, name, symbol, unit, values, way_of in rows:
        own = values[kept]
        if not np.isfinite(own).all() or not np.ptp(own):
            continue
        centre, scale = 0.0, 1.0
        if way_of == centred:
            centre, scale = float(own.max() + own.min()) / 2, float(np.ptp(own)) / 2
        elif way_of == signed:
            size = np.abs(own)
            scale = float(np.quantile(size[size > 1e-9 * size.max()], QUANTILE))
        elif way_of == "scaled":
            scale = float(np.abs(own).max())
        state = State(name, symbol, unit, centre, scale)
        found.append(Along(state, kind, (own - centre) / scale))
    return found


def columns_of(record: Record, kept: np.ndarray, notes: list[str]) -> list[Along]:
    """Auxiliary columns, each from its mean in parts of its deviation."""
    found: list[Along] = []
    for name, values in record.aux.items():
        own = values[kept]
        if not np.isfinite(own).all():
            gaps = int(np.count_nonzero(~np.isfinite(own)))
            notes.append(
                f"The column {name} has {gaps} rows without a number: no terms are made of it; "
                "fill the gaps."
            )
        elif not np.ptp(own) > 1e-9 * np.abs(own).max():
            notes.append(
                f"The column {name} is constant ({own[0]:g}): no terms are made of it; record it "
                "while it changes."
            )
        else:
            unit = record.channels[name].unit
            centre, scale = float(own.mean()), float(own.std())
            state = State(f"column {name}", name, unit, centre, scale)
            found.append(Along(state, "column", (own - centre) / scale))
    return found


def _speed(states: dict[str, Along]) -> Along | None:
    rate = states.get("rate")
    return rate and Along(rate.state, "rate", np.abs(rate.values))


def physics_of(*kinds: str) -> str:
    """Where to look for what makes a product of states of these kinds."""
    own = {kind.removesuffix(" of output") for kind in kinds}
    if len(own) == 1:
        return BY_KIND[own.pop()]
    if "column" in own:
        return OF_COLUMN_PRODUCT
    if frozenset(own) in BY_PAIR:
        return BY_PAIR[frozenset(own)]
    ranked = [kind for kind in BY_KIND if kind in own and kind not in ("position", "direction")]
    return f"{BY_KIND[ranked[0]]}; its size changes with the other state"


def _alone(found: Library, of: Along) -> None:
    """Terms of one state."""
    x, s, physics = of.values, of.state.symbol, physics_of(of.kind)
    found.add(s, physics, ORDERS["plain"], x, of)
    if of.kind == "direction":
        return
    found.add(f"{s}²", physics, ORDERS["square"], x**2, of)
    found.add(f"{s}³", physics, ORDERS["cube"], x**3, of)
    if of.kind in ("rate", "rate of output", "column"):
        for exponent, odd, order in (
            (1.0, False, "square"), (2.0, True, "square"), (0.5, True, "saturating")
        ):  # fmt: skip
            bent = power(s, x, exponent, NEXT_EXPONENT, odd=odd)
            found.add_shaped(bent, physics, ORDERS[order], of)
        for width in WIDTHS:
            bent = saturating(s, x, width, NEXT_WIDTH)
            found.add_shaped(bent, physics, ORDERS["saturating"], of)


def _products(
    found: Library, states: dict[str, Along], columns: Sequence[Along], speed: Along | None
) -> None:
    """Products of two states, and of a place with a bent rate."""
    listed: list[tuple[str, Along]] = [
        (each.state.symbol, each)
        for each in (*states.values(), *columns)
        if each.kind not in ("acceleration", "rate of output")
    ]
    if speed is not None:
        listed.append((f"|{speed.state.symbol}|", speed))
    for (name, one), (other, two) in itertools.combinations(listed, 2):
        values = one.values * two.values
        physics = physics_of(one.kind, two.kind)
        found.add(f"{name} · {other}", physics, ORDERS["product"], values, one, two)
    places = [states[kind] for kind in ("position", "output") if kind in states]
    for place, column in itertools.product(places, columns):
        x, c, own = column.values, column.state.symbol, place.state.symbol
        physics = physics_of(place.kind, column.kind)
        bent = power(c, x, 1.0, NEXT_EXPONENT, odd=False).times(own, place.values)
        found.add_shaped(bent, physics, ORDERS["bent product"], place, column)
        square = place.values * x**2
        found.add(f"{own} · {c}²", physics, ORDERS["bent product"], square, place, column)
    rate = states.get("rate")
    if rate is None:
        return
    r, s = rate.values, rate.state.symbol
    bent = [power(s, r, 2.0, NEXT_EXPONENT, odd=True),
            *(saturating(s, r, width, NEXT_WIDTH) for width in WIDTHS[1:])]  # fmt: skip
    order = ORDERS["bent product"]
    for each in (*places, *columns):
        physics, own, values = physics_of(each.kind, "rate"), each.state.symbol, each.values
        for shape in bent:
            found.add_shaped(shape.times(own, values), physics, order, each, rate)
        found.add(f"{own} · {s}²", physics, order, values * r**2, each, rate)
        found.add(f"{own} · {s}³", physics, order, values * r**3, each, rate)
        found.add(f"{own}² · {s}", physics, order, values**2 * r, each, rate)


def _memories(
    found: Library,
    states: dict[str, Along],
    columns: Sequence[Along],
    speed: Along | None,
    time: np.ndarray,
    starts: np.ndarray,
) -> None:
    """First-order memories of states, and of those the products with input and output."""
    of: list[tuple[str, np.ndarray, Along]] = [
        (each.state.symbol, each.values, each)
        for each in (*states.values(), *columns)
        if each.kind not in ("time", "turn", "acceleration", "path", "age", "rate of output")
    ]
    if "position" in states:
        place = states["position"]
        of.append((f"{place.state.symbol}²", place.values**2, place))
    if speed is not None:
        s = speed.state.symbol
        of += [(f"|{s}|", speed.values, speed), (f"{s}²", speed.values**2, speed)]
    step, whole = float(np.median(np.diff(time))), float(time[-1] - time[0])
    constants = np.geomspace(4 * step, whole / 4, MEMORIES)
    ratio = float(constants[1] / constants[0])
    signals = np.stack([values for _, values, _ in of], axis=1)
    kept = low_pass(signals, time, constants, starts)
    gains = [states[k] for k in ("position", "output") if k in states]
    for position, (name, signal, own) in enumerate(of):
        for place, tau in enumerate(constants.tolist()):
            values = kept[:, position, place]
            shape = memory(name, signal, tau, ratio, time, starts)
            label, order = shape.formula(tau), ORDERS["memory"]
            found.add(label, OF_MEMORY, order, values, own, shape=shape)
            if own.kind not in ("rate", "column"):
                continue
            for gain in gains:
                symbol, scale = gain.state.symbol, gain.values
                product = shape.times(symbol, scale, bracketed=True)
                told, order = product.formula(tau), ORDERS["memory product"]
                found.add(told, OF_MEMORY_PRODUCT, order, scale * values, gain, own, shape=product)
