"""The body of a model with a `restoring_force`, and its output along a record."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.effects.restoring_force import BOUC_WEN, RestoringForce
from preisach_jax.errors import InputError
from preisach_jax.mechanics.laws import Law, OneState, Operator
from preisach_jax.mechanics.motion import Body, Force, State, motion, substeps_of
from preisach_jax.operator.plane import Plane

FARTHEST = 2.0
"""Times the displacement of the record that was fitted up to which a prediction is believed."""

LEAST_SAMPLES = 8
"""Samples that the spline through the force takes."""

CLOSES = 3.0
"""Times what is above the band of an input anyway that its end may add there if it closes."""

UNEVEN = 0.01
"""Share of the time step by which steps may differ."""

QUIET = 1e-5
"""Share of the power of an input above its band from which on nothing can be seen there."""


def body_of(
    effect: RestoringForce, values: Mapping[str, float], plane: Plane, weights: Any
) -> Body[Any]:
    """The body of a model.

    Arguments:
        weights: (cells,) weights, in units of force.
    """
    stiffness = jnp.asarray(values["stiffness"], dtype=float)
    omega = 2 * np.pi * values["f_hz"]
    law: Law
    if effect.law == BOUC_WEN:
        shape = [jnp.asarray(values[name], dtype=float) for name in ("beta", "gamma", "n")]
        law = OneState(values["share"] * stiffness, jnp.asarray(effect.range_z), *shape)
    else:
        law = Operator(plane, jnp.asarray(weights, dtype=float))
    rest = (1 - values["share"]) * stiffness
    return Body(stiffness / omega**2, 2 * values["zeta"] * stiffness / omega, rest, law)


def fitted_start(effect: RestoringForce, plane: Plane) -> State:
    """The state at the first sample of the record that was fitted."""
    return _state(effect, plane, effect.start_z, effect.start_speed, effect.start_y)


def at_rest(effect: RestoringForce, plane: Plane) -> State:
    """The state of a body at rest and demagnetised."""
    return _state(effect, plane, 0.0, 0.0, 0.0)


def _state(effect: RestoringForce, plane: Plane, z: float, speed: float, y: float) -> State:
    place = jnp.asarray(z, dtype=float)
    if effect.law == BOUC_WEN:
        memory = jnp.asarray([y], dtype=float)
    else:
        operator = Operator(plane, jnp.zeros(plane.cells))
        memory = operator.committed(operator.demagnetised(place.dtype), place)
    return place, jnp.asarray(speed, dtype=float), memory


def along(
    body: Body[Any], start: State, time: np.ndarray, force: np.ndarray, f_hz: float
) -> tuple[np.ndarray, State]:
    """Displacement along a force, and the state at its end.

    Arguments:
        time: (time,) times, in s.
        force: (time,) force.
    """
    if len(time) < LEAST_SAMPLES:
        raise InputError(
            f"the record has {len(time)} samples, and the force between them is not known from "
            f"fewer than {LEAST_SAMPLES}; give a longer record"
        )
    path, last = _moved(body, Force.through(time, force), start, substeps_of(time, f_hz))
    return np.asarray(path), last


@eqx.filter_jit
def _moved(body: Body[Any], force: Force, start: State, substeps: int) -> tuple[Array, State]:
    return motion(body, force, start, substeps)


def closes(time: np.ndarray, force: np.ndarray) -> bool:
    """Whether an input repeats: its end goes over into its start as if it were one period of it.

    Behind a period cut anywhere else, the jump between the ends fills the spectrum above the band.

    Arguments:
        time: (time,) times, in s; where they are not even, the answer is no.
        force: (time,) input.
    """
    count, steps = len(force), np.diff(time)
    if np.ptp(steps) > UNEVEN * np.median(steps):
        return False
    centred = force - force.mean()
    cut = np.abs(np.fft.rfft(centred)) ** 2
    window = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 4
    shaped = np.abs(np.fft.rfft(centred * window)) ** 2 / np.mean(window**2)
    total = np.asarray(np.cumsum(shaped), float)
    if total[-1] == 0:
        return True
    last = int(np.sum(total < 0.999 * total[-1]))
    edge = min(int(1.3 * last) + 8, count)
    if len(cut) - edge < count // 20:
        return False  # the band reaches up to half the sampling rate
    floor, found = float(np.mean(shaped[edge:])), float(np.mean(cut[edge:]))
    quiet = floor * (len(cut) - edge) <= QUIET * total[-1]
    return bool(quiet and found <= CLOSES * floor + 1e-20 * total[-1])
