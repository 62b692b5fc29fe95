r"""What the remainder of a model goes with, how strongly, and what physics does that.

The rows are sorted by a quantity, such as the position of the input, and cut into parts of equal
numbers.  The share of the remainder's power that the means of the parts explain is Pearson's
correlation ratio,

\[ \eta^2 = \sum_p n_p \bar e_p^2 \Big/ \sum_k e_k^2 \]

(K. Pearson, On the general theory of skew correlation and non-linear regression, Drapers' Company
Research Memoirs 1905).  Of the rate and of its logarithm it is the share that a straight line
explains, which tells the two apart.  Something slow explains a part of everything that is slow, so
that chance is measured with the remainder shifted round the record: it keeps its own course, and
loses what it goes with.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from preisach_jax.diagnosis.noise import innovations
from preisach_jax.quantity import quantity
from preisach_jax.record.core import Record
from preisach_jax.record.course import input_rate, last_move, last_reversal

PARTS = 16
"""Parts of equal numbers of rows."""

SHIFTS = 199
"""Shifted remainders by which chance is measured."""

LEVEL = 0.99
"""Share of the shifted remainders that a relation must exceed."""

LEAST_SHARE = 0.02
"""Share of the remainder's power, beyond chance, below which a relation is not worth a word."""

MOST_ROWS = 20_000
"""Rows that are looked at; more are averaged over neighbours."""

TIME_PARTS = 60
"""Stretches whose order is drawn anew where the relation to time itself is asked for."""

PHYSICS = {
    "input": "a nonlinear map of the input, or a plane that is too coarse",
    "output": "a nonlinear sensor, or a gain that changes with the position",
    "rate of the input": "viscous friction, a voltage that motion induces, a lag or a delay",
    "logarithm of the speed": "switching by thermal activation, as in relaxors, ferroelectrics and "
    "viscoelastic materials",
    "direction of the input": "dry friction, or a loop that hysterons of one sign cannot represent",
    "time": "drift, warming, ageing, or a sensor that has moved",
    "time since the last reversal": "creep, relaxation, or a leaking charge",
    "input at the last reversal": "minor loops that are not congruent or do not close: feedback of "
    "the output, reptation, load",
    "path since the last reversal": "a density finer than the plane, or friction before sliding",
}
"""What kind of physics makes a remainder that goes with a quantity."""

OF_COLUMN = "the quantity acts beside the input, or scales the loop"

OF_LINE = "a resonance that rings, or a hum"

OF_KNOWN_LINE = "what the {} that was found leaves there, whose law is not quite the machine's"

BY_LINE = ("rate of the input", "logarithm of the speed")
"""Quantities of which a straight line must explain the remainder."""

LINE_WIDTH = 0.15
"""Half width of a band of frequencies, as a share of its middle."""

LEAST_WAVES = 20
"""Waves of a line in the record, below which it is no line but a slow course."""

OUTLYING = 5.0
"""Robust deviations of an innovation beyond which it is a jump, not noise."""

LINE_STANDS_OUT = 4.0
"""Times the power of the bands beside it that a line's band must hold."""


@dataclass(frozen=True, eq=False)
class Relation:
    """A quantity that the remainder goes with.

    Attributes:
        quantity: its name.
        unit: its unit.
        along_move: whether the remainder is counted in the direction of the last move.
        share: share of the remainder's power that goes with it.
        chance: share that is reached by chance in one case of a hundred.
        physics: what kind of physics does that.
        position: (part,) median of the quantity in each part; empty for a line of frequency.
        mean: (part,) mean of the remainder, in output units.
        band: (part,) what its mean reaches by chance, in output units.
    """

    quantity: str
    unit: str
    along_move: bool
    share: float
    chance: float
    physics: str
    position: np.ndarray
    mean: np.ndarray
    band: np.ndarray

    def to_json(self) -> dict[str, Any]:
        """The relation as numbers and texts."""
        return {
            "goes_with": self.quantity,
            "unit": self.unit,
            "along_move": self.along_move,
            "share": self.share,
            "chance": self.chance,
            "physics": self.physics,
        }

    @property
    def text(self) -> str:
        """How strongly the remainder goes with the quantity, and what does that."""
        side = ", in the direction of the last move," if self.along_move else ""
        return (
            f"{100 * self.share:.0f} % of its power{side} goes with the {self.quantity} "
            f"({100 * self.chance:.1f} % by chance): {self.physics}"
        )


def relations(
    record: Record, residual: np.ndarray, lines: Mapping[str, Sequence[float]] | None = None
) -> tuple[Relation, ...]:
    """What a remainder goes with more than by chance, strongest first.

    Arguments:
        residual: (time,) measured minus modelled output, in output units.
        lines: frequencies in Hz that effects of the model have, by their names.

    Returns:
        The relations; of quantities that say nearly the same, such as input and output, each.
    """
    rows = _rows_of(record, residual)
    if not len(rows):
        return ()
    line = _line(record, residual[rows], lines or {})
    rows = _thinned(rows)
    move = last_move(record.input)[rows]
    found = [_relation(axis, residual[rows], move) for axis in _axes(record, rows)]
    told = [each for each in (*found, *line) if each.share > each.chance + LEAST_SHARE]
    return tuple(sorted(told, key=lambda each: -each.share))


def is_related(record: Record, residual: np.ndarray, least: float) -> bool:
    """Whether more than a share of a remainder, beyond chance, is what noise would not have.

    It goes with a quantity; or its magnitude does, as a gain that wanders or a friction makes it;
    or it lies at a line; or in jumps of few rows.

    Arguments:
        residual: (time,) measured minus modelled output, in output units.
        least: the share.
    """
    rows = _rows_of(record, residual)
    return bool(len(rows)) and any(share > least for share in _excesses(record, residual, rows))


def _excesses(record: Record, residual: np.ndarray, rows: np.ndarray) -> Iterator[float]:
    """Shares beyond chance, those first that cost least."""
    yield _share_of_jumps(residual[rows])
    yield from (each.share - each.chance for each in _line(record, residual[rows], {}))
    rows = _thinned(rows)
    move = last_move(record.input)[rows]
    magnitude = np.abs(residual[rows] - residual[rows].mean())
    for axis in _axes(record, rows):
        for values, along in ((residual[rows], axis.along_move), (magnitude, False)):
            one = _relation(replace(axis, along_move=along), values, move)
            yield one.share - one.chance


def _rows_of(record: Record, residual: np.ndarray) -> np.ndarray:
    """(row,) indices of the measured samples; empty if they are too few to tell anything."""
    rows = np.flatnonzero(record.measured & np.isfinite(residual))
    enough = len(rows) >= 4 * PARTS and np.ptp(residual[rows]) > 0
    return rows if enough else rows[:0]


def _thinned(rows: np.ndarray) -> np.ndarray:
    return rows[:: max(1, -(-len(rows) // MOST_ROWS))]


def _share_of_jumps(values: np.ndarray) -> float:
    """Share of the power of innovations in time order that are no noise: they stand out."""
    left = innovations(values)
    usual = np.median(np.abs(left)) / scipy.special.ndtri(0.75)
    power = left**2
    return float(power[np.abs(left) > OUTLYING * usual].sum() / power.sum()) if usual else 0.0


@dataclass(frozen=True, eq=False)
class _Axis:
    """A quantity along the rows, cut into parts.

    Attributes:
        quantity, unit, along_move: as those of a `Relation`.
        values: (row,) the quantity.
        part: (row,) part of each row.
        count: (part,) rows of each part.
    """

    quantity: str
    unit: str
    along_move: bool
    values: np.ndarray
    part: np.ndarray
    count: np.ndarray

    @staticmethod
    def of(name: str, unit: str, along_move: bool, values: np.ndarray) -> _Axis:
        """The axis, with equal values in one part, and about equally many in all."""
        rank = np.searchsorted(np.sort(values), values)
        part = np.unique(rank * PARTS // len(values), return_inverse=True)[1]
        return _Axis(name, unit, along_move, values, part, np.bincount(part))

    def means(self, values: np.ndarray) -> np.ndarray:
        """(part,) means of values along the rows."""
        return np.bincount(self.part, values) / self.count

    def explained(self, values: np.ndarray, means: np.ndarray) -> float:
        """Share of the power of values that goes with the quantity."""
        power = float(values @ values)
        if self.quantity in BY_LINE:
            centred = self.values - self.values.mean()
            return float((centred @ values) ** 2 / (centred @ centred) + values.sum() ** 2
                         / len(values)) / power  # fmt: skip
        return float(self.count @ means**2) / power


def _relation(axis: _Axis, values: np.ndarray, move: np.ndarray) -> Relation:
    """What values, (row,), have to do with a quantity, and what by chance."""
    values = values - values.mean()
    generator = np.random.default_rng(0)
    least = len(values) // 20
    lags = generator.integers(least, len(values) - least, SHIFTS)
    stretch = np.arange(len(values)) * TIME_PARTS // len(values)
    shares, means = np.zeros(SHIFTS), np.zeros((SHIFTS, len(axis.count)))
    for trial in range(SHIFTS):
        if axis.quantity == "time":  # shifted, a slow course stays one
            place = generator.permutation(TIME_PARTS)[stretch]
            moved = values[np.argsort(place, kind="stable")]
        else:
            moved = np.roll(values, lags[trial])
        moved = move * moved if axis.along_move else moved
        means[trial] = axis.means(moved)
        shares[trial] = axis.explained(moved, means[trial])
    own = move * values if axis.along_move else values
    mean = axis.means(own)
    return Relation(
        quantity=axis.quantity,
        unit=axis.unit,
        along_move=axis.along_move,
        share=axis.explained(own, mean),
        chance=float(np.quantile(shares, LEVEL)),
        physics=PHYSICS.get(axis.quantity, OF_COLUMN),
        position=np.array([np.median(axis.values[axis.part == k]) for k in range(len(mean))]),
        mean=mean,
        band=np.quantile(np.abs(means), LEVEL, axis=0),
    )


AT_REST = 1e-5
"""Speed, as a share of the greatest, below which the input rests."""


def _axes(record: Record, rows: np.ndarray) -> list[_Axis]:
    """The quantities that vary."""
    last, rate = last_reversal(record.input, None, record.starts), _rate(record)
    speed = np.abs(rate)
    moving = speed > AT_REST * speed.max()
    slow = float(np.quantile(speed[moving], 0.02)) if moving.any() else 1.0
    logarithm = np.log10(np.maximum(speed, slow))
    since, way = record.time - record.time[last], np.abs(record.input - record.input[last])
    unit_u, unit_z = record.input_unit, record.output_unit
    quantities = [
        ("input", unit_u, False, record.input),
        ("output", unit_z, False, record.output),
        ("rate of the input", record.rate_unit, False, rate),
        ("logarithm of the speed", f"log10({record.rate_unit})", True, logarithm),
        ("direction of the input", "", False, np.sign(rate)),
        ("time", record.time_unit, False, record.time),
        ("time since the last reversal", record.time_unit, True, since),
        ("input at the last reversal", unit_u, False, record.input[last]),
        ("path since the last reversal", unit_u, True, way),
    ]
    quantities += [
        (f"column {name}", record.channels[name].unit, False, column)
        for name, column in record.aux.items()
    ]
    return [
        _Axis.of(name, unit, along, values[rows])
        for name, unit, along, values in quantities
        if np.ptp(values[rows]) > 0
    ]


def _rate(record: Record) -> np.ndarray:
    return input_rate(record.time, record.input, record.starts)


def _line(
    record: Record, values: np.ndarray, lines: Mapping[str, Sequence[float]]
) -> list[Relation]:
    """The band of frequencies that stands out of those beside it, if one does."""
    window = np.hanning(len(values))
    power: np.ndarray = np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2
    frequency: np.ndarray = np.fft.rfftfreq(len(values), record.step_s)
    if len(power) - 1 <= LEAST_WAVES:
        return []
    middle = float(frequency[LEAST_WAVES + int(np.argmax(power[LEAST_WAVES:]))])
    low, inner, outer, high = (
        int(np.searchsorted(frequency, middle * (1 + LINE_WIDTH) ** k)) for k in (-3, -1, 1, 3)
    )
    own = float(power[inner:outer].sum())
    beside = float(power[low:inner].sum() + power[outer:high].sum())
    width = (outer - inner) / max(inner - low + high - outer, 1)
    nothing = np.zeros(0)
    share, chance = (float(each / power.sum()) for each in (own, LINE_STANDS_OUT * beside * width))
    name = f"frequency {quantity(middle, 'Hz', 3)}"
    known = [
        effect
        for effect, own in lines.items()
        if any((1 + LINE_WIDTH) ** -1 < middle / f_hz < 1 + LINE_WIDTH for f_hz in own)
    ]
    physics = OF_KNOWN_LINE.format(known[0]) if known else OF_LINE
    return [Relation(name, "Hz", False, share, chance, physics, nothing, nothing, nothing)]
