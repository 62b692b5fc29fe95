"""What of a fitted effect contradicts what it is: a line of the drive, or a value at a bound."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from preisach_jax.diagnosis.tellable import InputSurvey, surveyed
from preisach_jax.effects.base import AddedEffect, Effect, OutputEffect, Parameter
from preisach_jax.effects.speed import smoothed_rate
from preisach_jax.identify.problem import Point, Problem
from preisach_jax.look.stretches import Period
from preisach_jax.quantity import quantity
from preisach_jax.record.course import lattice_step

WIDE = 10.0
"""Ratio of its bounds from which on a parameter is searched for, and not known beforehand."""

AT_A_BOUND = 0.02
"""Distance from a bound, over that between both bounds, within which a parameter lies at it."""

BEYOND_ANY_PAST = 3.0
"""Change of the output that a creep puts down to its past, over the most that its gains allow for,
from which on it is none: gains are uncertain."""

OF_POSITION = 0.5
"""Correlation of a smoothed speed with the input, above that with the speed itself, from which on
it is no speed any more."""


def from_the_drive(problem: Problem, point: Point, name: str) -> str:
    """What says that a line is the drive's own doing; empty if nothing does, or it is no line."""
    effect = point.chain.effect(name)
    if not effect.line:
        return ""
    survey, f_hz = surveyed(problem), point.values[name][effect.line]
    if survey.makes(f_hz):
        return f"its line of {f_hz:.4g} Hz is a sum of low multiples of the drive's own lines"
    if (period := survey.period) is not None and is_tooth(problem, point, effect, f_hz, period):
        return (
            f"its line of {f_hz:.4g} Hz is a multiple of the drive's and hardly higher than those "
            f"beside it: the error comes back with the drive every {period.seconds:.3g} s, and a "
            "drive that does not repeat itself would tell them apart"
        )
    if is_of_steps(point, effect, f_hz, survey.runs):
        return (
            f"its line of {f_hz:.4g} Hz is in the recorded input too: a ramp that passes the steps "
            "of the input's converter in even time makes it"
        )
    return ""


def implausible(problem: Problem, point: Point, name: str) -> str:
    """What of a fitted effect contradicts what it is; empty if nothing does."""
    return from_the_drive(problem, point, name) or out_of_law(problem, point, name)


def out_of_law(problem: Problem, point: Point, name: str) -> str:
    """What of an effect's fitted parameters is none of what it is; empty if nothing is."""
    effect = point.chain.effect(name)
    survey, values = surveyed(problem), point.values[name]
    lag = effect.smoothed_by
    if lag and _goes_with_position(survey, values[lag]):
        return (
            f"its speed, {values[lag]:.3g} s late, goes with where the input is rather than "
            "with how fast it moves"
        )
    if isinstance(effect, OutputEffect) and (past := _more_than_its_past(problem, point, effect)):
        return past
    for parameter in effect.parameters():
        if side := _bound_of(parameter, values[parameter.name]):
            value = f"{values[parameter.name]:.4g} {problem.shown_unit(parameter.unit)}"
            return (
                f"its {parameter.name} of {value} lies at the {side} bound of the search: "
                "something else causes this error"
            )
    return ""


def _more_than_its_past(problem: Problem, point: Point, effect: OutputEffect) -> str:
    """What says that an effect's unknown past does what no past could; empty if nothing does.

    The elements of a creep decay from where an unknown past has left them, whatever their gains:
    with hardly any gain, they are a drift.  Beside a drift, they and it make up for each other.
    """
    added = [each for each in point.chain.effects if isinstance(each, AddedEffect)]
    drifts = (each.name for each in added if each.of_time_alone)
    if not effect.bounds_its_past or any(name in effect.confused_with for name in drifts):
        return ""
    left = float(np.ptp(point.share_of(effect.name))) * problem.unit
    stroke = float(np.abs(point.coefficients().weights).sum())
    bounds = effect.at(point.values[effect.name]).past_bound(problem.signals, stroke)
    most = float(np.max(np.asarray(bounds)))
    if left <= BEYOND_ANY_PAST * most:
        return ""
    unit = problem.record.output_unit
    kept = f"at most {quantity(most, unit, 2)}" if most > 0 else "none"
    return (
        f"{quantity(left, unit, 2)} of what it takes away is put down to the time before the "
        f"record, of which elements of its gains can have kept {kept}: it stands for a drift"
    )


_smoothed_rate: Any = jax.jit(smoothed_rate)


def _goes_with_position(survey: InputSurvey, tau_s: float) -> bool:
    """Whether the speed of an input, smoothed over some time, goes with the input and not with it.

    What is faster than the smoothing passes it as the input itself: (u - its mean of late) / tau.
    """
    products = np.zeros((3, 3))
    for time, values in survey.runs:
        late = np.asarray(_smoothed_rate(values, time, np.asarray(tau_s)))
        courses = np.stack([late, values, np.gradient(values, time)])
        courses -= courses.mean(axis=1, keepdims=True)
        products += courses @ courses.T
    size = np.sqrt(np.diag(products))
    of_place, of_speed = products[0, 1:] / (size[0] * size[1:])
    return bool(of_place > max(OF_POSITION, of_speed))


def _bound_of(parameter: Parameter, value: float) -> str:
    """Which bound of the search a parameter lies at, where a bound is no finding."""
    if not parameter.log or parameter.high < WIDE * parameter.low:
        return ""
    side = bound_near(parameter, value)
    found = parameter.open_ended == "both" or (side == "upper" and parameter.open_ended)
    return "" if found else side


def bound_near(parameter: Parameter, value: float) -> str:
    """Which bound of the search, "upper" or "lower", a parameter lies at; empty if none."""
    low, high, here = (parameter.to_search(v) for v in (parameter.low, parameter.high, value))
    share = (here - low) / (high - low)
    if share > 1 - AT_A_BOUND:
        return "upper"
    return "lower" if share < AT_A_BOUND else ""


NEIGHBOURS = 10
"""Teeth of the comb on either side of a line that are looked at."""

STANDS_OUT = 10.0
"""Height from which on a line at a multiple of the drive's is one of its own, over the highest of
them: teeth of development records had up to 3.4, lines of hums 50 and more."""

WITHIN = np.linspace(-1.0, 1.0, 9)
"""Places about a line of the input that count as it, over the length of the record."""

BESIDE = np.r_[-20:-3, 4:21]
"""Places beside a line of the input that are looked at, over the length of the record."""

STANDS_OUT_OF_INPUT = 3.0
"""Height from which on the recorded input has a line of its own, over the highest place beside it:
at hums of development records it had up to 1.3, at the line of a converter's steps 4."""

OF_THE_HUM = 0.5
"""Share of a hum that the line of the input must come to in the output."""


def is_of_steps(
    point: Point, hum: Effect, f_hz: float, inputs: Sequence[tuple[np.ndarray, np.ndarray]]
) -> bool:
    """Whether a hum is at a line that the steps of the recorded input make.

    What is recorded of a ramp differs from what acted by a sawtooth of as many periods as the ramp
    passes steps of the converter; samples fold its lines to anywhere.

    Arguments:
        inputs: (time,) seconds and input of each run, before it was thinned.
    """
    heights = _heights(point, hum)
    line_hz = (int(np.argmax(heights)) + 1) * f_hz
    span = max(float(np.ptp(values)) for _, values in inputs)
    least = OF_THE_HUM * float(heights.max()) * span / point.unit
    for time, values in inputs:
        if not lattice_step(values):
            continue
        moved, length = values - values.mean(), float(np.ptp(time))
        own = float(_amplitudes(time, moved, line_hz + WITHIN / length).max())
        beside = float(_amplitudes(time, moved, line_hz + BESIDE / length).max())
        if own > max(STANDS_OUT_OF_INPUT * beside, least):
            return True
    return False


def is_tooth(problem: Problem, point: Point, hum: Effect, f_hz: float, period: Period) -> bool:
    """Whether a hum is at a multiple of the drive's frequency, and no line of it stands out there.

    Whatever is wrong with a model comes back with a drive of period T, at all multiples of 1/T: a
    line of its own is far higher than those beside it, f ± j/T.
    """
    if not period.has_multiple(f_hz, float(np.ptp(problem.record.time))):
        return False
    time = problem.record.time[problem.rows]
    residual = point.residual * point.unit
    highest = 0.5 / problem.survey.step_s
    for multiple, own in enumerate(_heights(point, hum), 1):
        beside = multiple * f_hz + np.r_[-NEIGHBOURS:0, 1 : NEIGHBOURS + 1] / period.seconds
        beside = beside[(beside > 0.5 / period.seconds) & (beside < highest)]
        if not beside.size or own > STANDS_OUT * _amplitudes(time, residual, beside).max():
            return False
    return True


def _heights(point: Point, hum: Effect) -> np.ndarray:
    """(harmonic,) amplitudes of the lines of a hum, in the unit of the output."""
    pairs = zip(point.chain.coefficients, point.coefficients().added, strict=True)
    parts = [float(value) for (name, _), value in pairs if name == hum.name]
    return np.hypot(parts[::2], parts[1::2])


def _amplitudes(time: np.ndarray, values: np.ndarray, f_hz: np.ndarray) -> np.ndarray:
    """(line,) amplitudes of lines, by a Hann window."""
    window = np.sin(np.pi * (time - time.min()) / np.ptp(time)) ** 2
    turned = np.exp(-2j * np.pi * np.outer(f_hz, time))
    return 2 * np.abs(turned @ (window * values)) / window.sum()
