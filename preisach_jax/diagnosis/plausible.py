"""What of a fitted effect contradicts what it is: a line of the drive, or a value at a bound."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from preisach_jax.diagnosis.lines import is_of_steps, is_tooth
from preisach_jax.diagnosis.tellable import InputSurvey, surveyed
from preisach_jax.effects.base import Parameter
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.speed import smoothed_rate
from preisach_jax.effects.viscosity import Viscosity
from preisach_jax.identify import Point, Problem
from preisach_jax.quantity import quantity

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
    """What says that a hum is the drive's own doing; empty if nothing does, or it is no hum."""
    effect = point.chain.effect(name)
    if not isinstance(effect, Hum):
        return ""
    survey, f_hz = surveyed(problem), point.values[name]["f_hz"]
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
    if isinstance(effect, Viscosity) and _goes_with_position(survey, values["tau_s"]):
        return (
            f"its speed, {values['tau_s']:.3g} s late, goes with where the input is rather than "
            "with how fast it moves"
        )
    if isinstance(effect, Creep) and (past := _more_than_its_past(problem, point, effect)):
        return past
    for parameter in effect.parameters():
        if side := _bound_of(parameter, values[parameter.name]):
            value = f"{values[parameter.name]:.4g} {problem.shown_unit(parameter.unit)}"
            return (
                f"its {parameter.name} of {value} lies at the {side} bound of the search: "
                "something else causes this error"
            )
    return ""


def _more_than_its_past(problem: Problem, point: Point, effect: Creep) -> str:
    """What says that a creep's unknown past does what no past could; empty if nothing does.

    Its elements decay from where an unknown past has left them, whatever their gains are: with
    hardly any gain, they are a drift.  Beside a drift, they and it make up for each other.
    """
    if any(isinstance(each, Drift) for each in point.chain.effects):
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


def _goes_with_position(survey: InputSurvey, tau_s: float) -> bool:
    """Whether the speed of an input, smoothed over some time, goes with the input and not with it.

    What is faster than the smoothing passes it as the input itself: (u - its mean of late) / tau.
    """
    products = np.zeros((3, 3))
    for time, values in survey.runs:
        signal, times, tau = (jnp.asarray(each) for each in (values, time, tau_s))
        late = np.asarray(smoothed_rate(signal, times, tau))
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
