"""A closed loop in simulation: a controller around a stage, with and without its inverse."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.compensation.causal import Causal, CausalState
from preisach_jax.compensation.online import OnlineInverse
from preisach_jax.compensation.search import Limits
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import auxiliary_columns
from preisach_jax.errors import InputError
from preisach_jax.hooks import HOOKS
from preisach_jax.model import Model
from preisach_jax.record.core import Record

Stage = Callable[[float, Mapping[str, float]], float]
"""A stage in simulation: the next reading, from the drive and the auxiliary columns there."""

Controller = Callable[[float], float]
"""A controller: what it adds to the wanted output, from the error of the last reading."""


@dataclass(frozen=True, eq=False)
class Loop:
    """Readings along a wanted course, by how the drive was made.

    Attributes:
        time: (time,) s.
        wanted: (time,) in the unit of the output.
        readings: (time,) each, by name, in the order in which more and more is compensated.
        drives: (time,) each, by the same names, in the unit of the input.
        unit: unit of the output.
    """

    time: np.ndarray
    wanted: np.ndarray
    readings: Mapping[str, np.ndarray]
    drives: Mapping[str, np.ndarray]
    unit: str

    def errors(self, begin_s: float = 0.0) -> dict[str, float]:
        """RMS tracking error by name, from some time after the start on."""
        rows = self.time >= self.time[0] + begin_s
        return {
            name: float(np.sqrt(np.mean((reading - self.wanted)[rows] ** 2)))
            for name, reading in self.readings.items()
        }

    def plot(self) -> Any:
        """Figure of the errors over time and of their RMS as a waterfall."""
        return HOOKS["Loop.plot"](self)


class ProportionalIntegral:
    """A discrete PI controller, u(k) = K_p e(k) + K_i T Σ e.

    Arguments:
        proportional: K_p.
        integral_per_s: K_i, per s.
        rate_hz: sampling rate 1/T, in Hz.

    Example:
        >>> control = ProportionalIntegral(0.5, 10.0, 100.0)
        >>> control(1.0), round(control(1.0), 6)
        (0.6, 0.7)
    """

    def __init__(self, proportional: float, integral_per_s: float, rate_hz: float):
        self._proportional, self._gain, self._sum = proportional, integral_per_s / rate_hz, 0.0

    def __call__(self, error: float) -> float:
        self._sum += self._gain * error
        return self._proportional * error + self._sum


def simulated_stage(model: Model, rate_hz: float, after: Record | None = None) -> Stage:
    """A stage that does from sample to sample what a model says.

    Arguments:
        model: the model; a delay is left out.
        rate_hz: sampling rate in Hz.
        after: what was played before; by default the record on which the model was identified.

    Returns:
        The stage.
    """
    with on_processor():
        free = Limits(model.plane.low, model.plane.high, math.inf)
        causal = Causal.of(model, rate_hz, free, after)
        state = causal.start()
        step: Callable[[CausalState, Array], tuple[CausalState, Array]] = jax.jit(causal.played)

    return _Played(step, state, auxiliary_columns(model.effects))


class _Played:
    """A stage that keeps its state between two samples."""

    def __init__(
        self,
        step: Callable[[CausalState, Array], tuple[CausalState, Array]],
        state: CausalState,
        columns: list[str],
    ):
        self._step, self._state, self._columns = step, state, columns

    def __call__(self, drive: float, aux: Mapping[str, float]) -> float:
        with on_processor():
            sample = np.array([drive, *(aux[name] for name in self._columns)])
            self._state, reading = self._step(self._state, jnp.asarray(sample))
            return float(reading)


def of_control(system: Any) -> Controller:
    """A discrete system of python-control as a controller, from the error to the correction."""
    if getattr(system, "ninputs", 1) != 1 or getattr(system, "noutputs", 1) != 1:
        raise InputError(
            f"the controller has {system.ninputs} inputs and {system.noutputs} outputs; give "
            "one with one input, the error, and one output"
        )
    if system.dt is None or system.dt == 0:
        raise InputError(
            f"the controller is continuous (dt is {system.dt}); make it discrete (control.c2d)"
        )
    if not hasattr(system, "dynamics"):
        import control  # pyright: ignore[reportMissingImports]

        system = control.tf2ss(system)
    state, at = np.zeros(system.nstates), 0

    def act(error: float) -> float:
        nonlocal state, at
        output = system.output(at, state, np.array([error]))
        state = np.asarray(system.dynamics(at, state, np.array([error])))
        at += 1
        return float(np.ravel(output)[0])

    return act


def simulate_loop(
    model: Model,
    wanted: Record,
    *,
    stage: Callable[[], Stage] | None = None,
    controller: Callable[[], Any] | None = None,
    limits: tuple[float, float] | None = None,
    after: Record | None = None,
) -> Loop:
    """Close a loop around a stage, in simulation, with more and more of the model's inverse.

    The controller adds to the wanted output what the error of the last reading asks for, and the
    sum goes to the drive: through a straight line between the ends of the stroke ("no
    compensation"), through the line that fits model and course best ("affine map"), through the
    inverse of the hysteresis alone, whose zero is set at the first sample, and through that of all
    effects.

    Arguments:
        model: the model.
        wanted: the course as the output, with time and auxiliary columns; evenly sampled.
        stage: makes the stage anew for each of these; by default the model itself.
        controller: makes the controller anew for each: any function of an error, such as
            `ProportionalIntegral`, or a discrete system of python-control; by default none acts.
        limits: of the drive; by default the range of the plane.
        after: what was played before; by default the record on which the model was identified.

    Returns:
        Readings and drives.

    Raises:
        InputError: the course is not evenly sampled, or the model lacks an auxiliary column.

    Example:
        >>> import preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9).model
        >>> course = pj.Record.from_arrays(t[:99], 0 * t[:99], 6 + 3 * np.sin(t[:99]))
        >>> errors = pj.simulate_loop(model, course).errors()
        >>> errors["all effects"] < 1e-6 < errors["affine map"]
        True
    """
    steps = np.diff(wanted.time)
    if np.ptp(steps) > 1e-3 * wanted.step_s:
        raise InputError(f"{wanted.name}: the course is not evenly sampled; resample it")
    rate, low, high = 1 / wanted.step_s, *(limits or (model.plane.low, model.plane.high))
    # One of each is compiled; what runs are copies, each of which begins as it did.
    whole, plain = (
        OnlineInverse(some, rate, (low, high), after=after)
        for some in (model, _without_effects(model))
    )
    at_rest = None if stage else simulated_stage(model, rate, after)
    make = stage or (lambda: cast(Stage, copy(at_rest)))

    def running(compiled: OnlineInverse) -> Callable[[float, Mapping[str, float]], float]:
        inverse = copy(compiled)
        return lambda value, aux: inverse(value, aux=aux)

    def zeroed() -> Callable[[float, Mapping[str, float]], float]:
        # What the effects of the past have left is taken off as the zero of the stage.
        aux = {name: float(values[0]) for name, values in wanted.aux.items()}
        first = float(wanted.output[0])
        off = make()(running(plain)(first, aux), aux) - first
        inverse = running(plain)
        return lambda value, aux: inverse(value - off, aux)

    ways: dict[str, Callable[[], Callable[[float, Mapping[str, float]], float]]] = {
        "no compensation": lambda: _straight(model),
        "affine map": lambda: _affine(running(whole), wanted),
        "hysteresis only": zeroed,
        "all effects": lambda: running(whole),
    }
    readings: dict[str, np.ndarray] = {}
    drives: dict[str, np.ndarray] = {}
    # One sample after the other: controllers and stages are the user's own functions.
    for name, way in ways.items():
        control = _controller(controller)
        readings[name], drives[name] = _run(wanted, way(), make(), control, low, high)
    unit = model.units.get("output", "")
    return Loop(wanted.time, wanted.output, readings, drives, unit)


def _controller(make: Callable[[], Any] | None) -> Controller:
    if make is None:
        return lambda error: 0.0
    made = make()
    return of_control(made) if hasattr(made, "ninputs") else made


def _run(
    wanted: Record,
    to_drive: Callable[[float, Mapping[str, float]], float],
    stage: Stage,
    control: Controller,
    low: float,
    high: float,
) -> tuple[np.ndarray, np.ndarray]:
    readings, drives = np.empty(len(wanted)), np.empty(len(wanted))
    error = 0.0
    for k, value in enumerate(wanted.output.tolist()):
        aux = {name: float(values[k]) for name, values in wanted.aux.items()}
        drives[k] = min(max(to_drive(value + control(error), aux), low), high)
        readings[k] = stage(drives[k], aux)
        error = value - readings[k]
    return readings, drives


def _straight(model: Model) -> Callable[[float, Mapping[str, float]], float]:
    """The line from one end of the model's stroke to the other."""
    plane, stroke = model.plane, float(model.weights.sum())
    slope = (plane.high - plane.low) / stroke
    bottom = model.offset if stroke > 0 else model.offset + stroke
    start = plane.low if stroke > 0 else plane.high
    return lambda value, aux: start + slope * (value - bottom)


def _affine(
    inverse: Callable[[float, Mapping[str, float]], float], wanted: Record
) -> Callable[[float, Mapping[str, float]], float]:
    """The line that fits the drive of all effects best: no line does better on this course."""
    drives = [
        inverse(float(value), {n: float(v[k]) for n, v in wanted.aux.items()})
        for k, value in enumerate(wanted.output)
    ]
    slope, level = np.polyfit(wanted.output, np.array(drives), 1)
    return lambda value, aux: float(level + slope * value)


def _without_effects(model: Model) -> Model:
    """The hysteresis of a model alone."""
    chain = model.chain.with_effects(())
    own = replace(model.coefficients, added=np.zeros(0))
    return replace(model, chain=chain, values={}, coefficients=own, parameters={})
