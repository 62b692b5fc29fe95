"""What a record can tell of each effect, and what it would have to hold besides.

Lags, delays and resonances are seen at speed, creep and drift at rest, ageing in repeats, feedback
of the output in minor loops at several biases.  The rules judge the input, not the output: what a
record can tell need not be there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from preisach_jax.look.stretches import Stretch, Stroke, band_decades, period, runs
from preisach_jax.quantity import quantity
from preisach_jax.record.core import Record
from preisach_jax.record.joined import joined

Grade = Literal["well", "poorly", "not at all"]

DECADES = 1.5
"""Spread of rates, in decades, that tells dynamic effects from the shape of the loop."""

HOLD_DECADES = 1.0
"""Spread of the lengths of rests that tells creep from a single lag."""

FASTEST_SAMPLES = 200
"""Samples of the fastest stroke beyond which nothing fast is seen."""

LEAST_LOOPS = 3
"""Repeats of a loop from which on it is seen whether it stays the same."""

BIASES = 3
"""Places at which minor loops must lie for their shapes to be compared."""

SAME = 0.03
"""Share of the range within which two turning points are the same."""


@dataclass(frozen=True)
class Prospect:
    """What a record can tell of an effect.

    Attributes:
        effect: its name.
        grade: how well the record shows it, if it is there.
        why: by what the record holds or lacks.
        remedy: what to record besides, `""` where nothing is missing.
    """

    effect: str
    grade: Grade
    why: str
    remedy: str = ""


@dataclass(frozen=True, eq=False)
class Excitation:
    """What the input of a record does.

    Attributes:
        record: the measurement.
        turns: rows at which the input turns.
        rests: where it keeps still.
        strokes: its moves over a tenth of the range or more.
        noise: RMS of the noise of the output.
        output_step, input_step: steps of converters, 0 where none is seen.
        parts: those of each record, where there are several: drift and ageing begin anew in each.
    """

    record: Record
    turns: np.ndarray
    rests: tuple[Stretch, ...]
    strokes: tuple[Stroke, ...]
    noise: float
    output_step: float
    input_step: float
    parts: tuple[Excitation, ...] = ()

    @property
    def rates(self) -> tuple[float, float]:
        """Slowest and fastest rate of the strokes, 5 % at either end left out."""
        rates = np.array([stroke.rate for stroke in self.strokes])
        if not rates.size:
            return float("nan"), float("nan")
        low, high = np.quantile(rates, [0.05, 0.95])
        return float(low), float(high)

    @property
    def decades(self) -> float:
        """Spread of the strokes' rates in decades; 0 where there are no strokes."""
        low, high = self.rates
        return float(np.log10(high / low)) if self.strokes else 0.0

    @cached_property
    def spread(self) -> float:
        """Decades of rates, or of frequencies where the input is a multisine or noise."""
        steps = np.abs(np.diff(self.record.input))
        usual = float(np.median(steps))
        is_irregular = float(np.median(np.abs(steps - usual))) > 0.3 * usual
        return max(self.decades, band_decades(self.record.input) if is_irregular else 0.0)

    @cached_property
    def period(self) -> int | None:
        """Samples after which the input repeats itself, if it does."""
        return period(self.record.input)

    @property
    def fastest_samples(self) -> float:
        """Samples that the fastest rate takes for the whole range."""
        _, high = self.rates
        return self.record.input_range / high / self.record.step_s if self.strokes else np.inf

    @property
    def levels(self) -> np.ndarray:
        """(turn,) input at the turns, as shares of the range."""
        ends = np.concatenate([[0], self.turns, [len(self.record) - 1]])
        low = self.record.input.min()
        return (self.record.input[ends] - low) / self.record.input_range

    @cached_property
    def repeats(self) -> int:
        """How often the whole input, or the loop that is met most often, comes in one record."""
        if self.parts:
            return max(part.repeats for part in self.parts)
        whole = len(self.record) // self.period if self.period else 0
        pairs = np.round(np.sort(np.stack([self.levels[:-1], self.levels[1:]], 1), axis=1) / SAME)
        pairs = pairs[pairs[:, 1] - pairs[:, 0] > STROKE_CELLS]
        if not len(pairs):
            return whole
        _, counts = np.unique(pairs, axis=0, return_counts=True)
        # Of many irregular turns some are alike by chance.
        is_chance = len(pairs) > 50 and counts.max() < 0.1 * len(pairs)
        return max(whole, 0 if is_chance else int(counts.max()) // 2)

    def biases(self) -> int:
        """At how many places minor loops lie: closed, and well within the range."""
        ends: np.ndarray = np.sort(np.stack([self.levels[:-1], self.levels[1:]]), axis=0)
        low: np.ndarray = ends[0]
        high: np.ndarray = ends[1]
        minor = (high - low < 0.7) & (high - low > 2 * SAME)
        middle: np.ndarray = 0.5 * (low + high)
        return int(np.unique(np.round(10 * middle[minor])).size)


def of_several(found: Sequence[Excitation]) -> Excitation:
    """What the inputs of several records do, one after the other; noise and steps of the first."""
    record = joined([each.record for each in found])
    begin = [run.start for run in record.runs]

    def moved(stretch: Stretch | Stroke, by: int) -> Any:
        return replace(stretch, start=stretch.start + by, stop=stretch.stop + by)

    turns = [each.turns + by for each, by in zip(found, begin, strict=True)]
    ends = np.array([row for run in record.runs for row in (run.start, run.stop - 1)][1:-1])
    return replace(
        found[0],
        record=record,
        parts=tuple(found),
        turns=np.unique(np.concatenate([*turns, ends])),
        rests=tuple(
            moved(r, by) for each, by in zip(found, begin, strict=True) for r in each.rests
        ),
        strokes=tuple(
            moved(s, by) for each, by in zip(found, begin, strict=True) for s in each.strokes
        ),
    )


STROKE_CELLS = 3  # cells of SAME that a stroke has at least


def rate_text(rate: float, unit: str) -> str:
    """A rate of the input in words."""
    return quantity(rate, f"{unit}/s", 3) if unit else f"{rate:.3g} per s"


def _of_rates(found: Excitation) -> str:
    low, high = found.rates
    if not found.strokes:
        return "no stroke covers a tenth of the range"
    unit = found.record.input_unit
    if found.spread > found.decades:
        return f"frequencies over {found.spread:.1f} decades"
    if found.decades < 0.1:
        return f"one rate, {rate_text(high, unit)}"
    return (
        f"rates from {rate_text(low, unit)} to {rate_text(high, unit)} "
        f"({found.decades:.1f} decades)"
    )


_SLOW_AND_FAST = "the same loop at three rates or more over a decade and a half"


def _dynamic(found: Excitation) -> tuple[Grade, str, str]:
    """Lags, delays, rate dependence: they need several rates."""
    if not found.strokes:
        return "not at all", _of_rates(found), _SLOW_AND_FAST
    grade: Grade = "well" if found.spread >= DECADES else "poorly"
    if found.spread < 0.3:
        grade = "not at all"
    remedy = "" if grade == "well" else _SLOW_AND_FAST
    return grade, _of_rates(found), remedy


def _fast(found: Excitation) -> tuple[Grade, str, str]:
    """Delays, lags and resonances: a fast stroke must show them above the noise."""
    grade, why, remedy = _dynamic(found)
    samples = found.fastest_samples
    if grade != "not at all" and samples > FASTEST_SAMPLES:
        step = quantity(found.record.step_s, "s", 2)
        why = f"{why}; the fastest takes {samples:.0f} samples of {step} for the range"
        return "poorly", why, "faster strokes, or a short multisine"
    return grade, why, remedy


def _resonance(found: Excitation) -> tuple[Grade, str, str]:
    grade, why, remedy = _fast(found)
    remedy = "steps, or a multisine beyond the suspected frequency" if grade != "well" else remedy
    return grade, why, remedy


def _of_rests(found: Excitation) -> tuple[int, int, float, str]:
    """Rests after rising and after falling moves, decades of their lengths, and the words."""
    rising = falling = 0
    lengths: list[float] = []
    values, step = found.record.input, found.record.step_s
    for rest in found.rests:
        lengths.append(max(rest.length_s, step))
        before = values[max(rest.start - 5 * (rest.stop - rest.start), 0) : rest.start + 1]
        if before.size < 2:
            continue
        rising += bool(rest.level > np.median(before))
        falling += bool(rest.level < np.median(before))
    if not lengths:
        return 0, 0, 0.0, "the input never rests"
    decades = float(np.log10(max(lengths) / min(lengths)))
    return rising, falling, decades, (
        f"{len(lengths)} rests of {quantity(min(lengths), 's', 3)} to "
        f"{quantity(max(lengths), 's', 3)}, {rising} after rising and {falling} after falling moves"
    )  # fmt: skip


_HOLDS = "rests of increasing length, over two decades, after moves in both directions"


def _creep(found: Excitation) -> tuple[Grade, str, str]:
    rising, falling, decades, why = _of_rests(found)
    both = min(rising, falling) >= 1
    if both and decades >= HOLD_DECADES:
        return "well", why, ""
    if rising + falling > 0:
        return "poorly", why, _HOLDS
    if found.spread >= DECADES:
        return "poorly", f"{why}, but there are {_of_rates(found)}", _HOLDS
    return "not at all", why, _HOLDS


def _operator_creep(found: Excitation) -> tuple[Grade, str, str]:
    grade, why, remedy = _creep(found)
    if grade == "well" and found.biases() < BIASES:
        return "poorly", f"{why}, all after large moves", "rests after small moves as well"
    return grade, why, remedy


_AGAIN = "the same loop at the beginning and at the end, and three times in a row"


def _repeated(found: Excitation) -> tuple[Grade, str, str]:
    """Drift, ageing: the same loop must come again later."""
    count = found.repeats
    why = f"the most frequent loop occurs {count} times" if count else "no loop comes again"
    if count >= LEAST_LOOPS:
        return "well", why, ""
    return ("poorly" if count == 2 else "not at all"), why, _AGAIN


def _drift(found: Excitation) -> tuple[Grade, str, str]:
    grade, why, remedy = _repeated(found)
    if grade != "well" and found.rests:
        return "poorly", f"{why}; {_of_rests(found)[3]}", remedy
    return grade, why, remedy


_MINOR = "minor loops of equal swing at five biases or more, on both branches"


def _minor_loops(found: Excitation) -> tuple[Grade, str, str]:
    """Feedback of the output and bent sensors: loops at several places."""
    count = found.biases()
    why = f"minor loops at {count} place{'s' * (count > 1)}" if count else "no minor loops"
    if count >= BIASES:
        return "well", why, ""
    return ("poorly" if count else "not at all"), why, _MINOR


def _nonlinearity(found: Excitation) -> tuple[Grade, str, str]:
    grade, why, remedy = _minor_loops(found)
    why = f"{why}; the density absorbs most of a sensor's nonlinearity"
    return "poorly" if grade == "well" else grade, why, remedy


def _reptation(found: Excitation) -> tuple[Grade, str, str]:
    levels = np.round(found.levels / SAME)
    again = (levels[2:] == levels[:-2]) & (np.abs(np.diff(levels))[:-1] * SAME < 0.7)
    starts, stops = runs(again)
    repeated = int(np.sum(stops - starts >= 2 * LEAST_LOOPS - 2))
    why = f"{repeated} minor loops are repeated" if repeated else "no minor loop is repeated"
    if repeated:
        return "well", why, ""
    return "not at all", why, "minor loops that are repeated ten times"


def _hum(found: Excitation) -> tuple[Grade, str, str]:
    record = found.record
    rate = 1 / record.step_s
    shown = quantity(rate, "Hz", 3)
    if rate < 110 or record.duration_s < 0.2:
        why = f"{shown} for {quantity(record.duration_s, 's', 2)}"
        return "not at all", why, "sample at 500 Hz or more, for a second or longer"
    return "well", f"sampled at {shown}, above twice the mains' frequency", ""


def _output_steps(found: Excitation) -> tuple[Grade, str, str]:
    return _steps(found.output_step, found.record.output_unit, "output", found.noise)


def _input_steps(found: Excitation) -> tuple[Grade, str, str]:
    return _steps(found.input_step, found.record.input_unit, "input", 0.0)


def _steps(step: float, unit: str, side: str, noise: float) -> tuple[Grade, str, str]:
    if step > 0 and step > noise:
        return "well", f"the {side} lies on steps of {quantity(step, unit, 3)}", ""
    return "well", f"the {side} does not lie on steps", ""


_RULES: Mapping[str, Callable[[Excitation], tuple[Grade, str, str]]] = {
    "input_lag": _fast,
    "output_lag": _fast,
    "delay": _fast,
    "slew_limit": _fast,
    "eddy_currents": _dynamic,
    "rate_dependence": _dynamic,
    "log_rate": _dynamic,
    "viscosity": _dynamic,
    "excess_loss": _dynamic,
    "resonance": _resonance,
    "restoring_force": _resonance,
    "creep": _creep,
    "operator_creep": _operator_creep,
    "drift": _drift,
    "leakage": _creep,
    "ageing": _repeated,
    "reptation": _reptation,
    "moving": _minor_loops,
    "output_nonlinearity": _nonlinearity,
    "hum": _hum,
    "input_quantisation": _input_steps,
    "output_quantisation": _output_steps,
}
"""What judges each effect by its name; effects of one's own are not judged."""


def judged_effects() -> tuple[str, ...]:
    """Names of the effects that are judged: all of the library, which need not be loaded."""
    return tuple(_RULES)


def needing_a_clock() -> tuple[str, ...]:
    """Names of the effects that are judged by rates, rests or frequencies."""
    of_time = (_fast, _dynamic, _resonance, _creep, _operator_creep, _hum)
    return tuple(name for name, rule in _RULES.items() if rule in of_time)


def prospects(found: Excitation, effects: tuple[str, ...] | None = None) -> tuple[Prospect, ...]:
    """What a record can tell of effects."""
    record = found.record
    names = [n for n in (judged_effects() if effects is None else effects) if n in _RULES]
    judged = [
        Prospect(name, *_RULES[name](found))
        if record.has_clock or name not in needing_a_clock()
        else Prospect(name, "not at all", "the record has no clock", "the time as well")
        for name in names
    ]
    for name, values in record.aux.items():
        judged.append(Prospect(f"aux:{name}", *_auxiliary(values, record)))
    return tuple(judged)


def _auxiliary(values: np.ndarray, record: Record) -> tuple[Grade, str, str]:
    if np.ptp(values) == 0:
        return "not at all", "it is constant", "vary it while the same loop is repeated"
    along = {"the input": record.input, "time": record.time}
    for what, other in along.items():
        share = float(np.corrcoef(values, other)[0, 1] ** 2)
        if share > 0.9:
            return "poorly", f"{100 * share:.0f} % of it goes with {what}", "vary it by itself"
    return "well", "it varies by itself", ""
