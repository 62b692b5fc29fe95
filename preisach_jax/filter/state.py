"""What recursions for the weights start from, carry from sample to sample, record, and return."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike, DTypeLike

from preisach_jax.errors import InputError
from preisach_jax.operator.inputs import as_float, as_signal, require_finite, require_hysteron
from preisach_jax.operator.plane import Plane, hysteron_step
from preisach_jax.operator.states import path_and_start, require_on_plane, require_plane

MOST_SAMPLES = 2**31 - 1
"""Samples of one run: they are counted in 32 bits. An `OnlineFilter` takes any number of runs."""


class FilterState(eqx.Module):
    """What the adaptive filter carries from one sample to the next (a pytree).

    Attributes:
        weights: (cells,) estimate R̂, in the unit of the output.
        states: (cells,) hysteron states in [0, 1].
        input: () input of the last sample.
        reference_states: (cells,) hysteron states at the sample from which differences run.
        reference_output: () measured output there; NaN while there is none.
    """

    weights: jax.Array
    states: jax.Array
    input: jax.Array
    reference_states: jax.Array
    reference_output: jax.Array


class FilterInfo(NamedTuple):
    """What the adaptive filter records of one sample.

    Attributes:
        output: () model output ẑ(k), eq. (6), with the weights before the update.
        error: () differential output error e(k), eq. (7), since the reference sample; NaN
            where there is no measured output.
        switched: () A(k), eq. (11): how many hysterons switched and were updated (ramps: sᵀs);
            0 without update.
    """

    output: jax.Array
    error: jax.Array
    switched: jax.Array


class FilterResult(NamedTuple):
    """What a run of the adaptive filter returns.

    Attributes:
        weights: (cells,) weights R̂ after the last sample, in the unit of the output.
        output: (time,) model output ẑ(k), with the weights of that time, before the update.
        error: (time,) differential output error e(k); NaN where there is no measured output.
        switched: (time,) A(k); 0 where nothing was updated.
        state: the filter's state after the last sample, from which a run can be continued.
    """

    weights: jax.Array
    output: jax.Array
    error: jax.Array
    switched: jax.Array
    state: FilterState


def checked_adapt(adapt: Any) -> bool:
    """Refuse a switch between learning and not learning that is neither true nor false."""
    if not isinstance(adapt, bool | np.bool_):
        raise InputError(f"adapt is {adapt!r}: give True or False")
    return bool(cast(bool, adapt))


def require_one_number(name: str, value: ArrayLike) -> None:
    """Refuse a setting that is not one real number; a traced one may be."""
    _require_numbers(name, value, "give one number")
    if np.shape(value) != ():
        raise InputError(f"{name} has the shape {np.shape(value)}: give one number")


def require_between(
    name: str, value: ArrayLike | None, words: str, *, least: bool = False, high: float = 2.0
) -> None:
    """Refuse a setting that does not lie between 0, excluded unless it is `least`, and `high`."""
    if value is None:
        return
    require_one_number(name, value)
    if isinstance(value, Tracer):
        return
    number = np.asarray(value).item()
    if not (0.0 < number < high or (least and number == 0.0)):
        raise InputError(f"{name} is {value}: give a number {words}")


def require_state(plane: Plane, state: Any, kind: type[Any]) -> None:
    """Refuse a state from which a run on a plane cannot be continued."""
    if not isinstance(state, kind):
        raise InputError(f"the state is {type(state).__name__}: give a {kind.__name__}")
    shape = state.weights.shape
    if shape != (plane.cells,):
        raise InputError(
            f"state has weights of the shape {shape}: give a state of this plane, ({plane.cells},)"
        )


def check_start(plane: Plane, hysteron: str, initial_weight: ArrayLike) -> None:
    """Refuse a setting that no recursion for the weights can start from."""
    require_plane(plane)
    require_hysteron(hysteron)
    remedy = f"give one number or ({plane.cells},)"
    _require_numbers("initial_weight", initial_weight, remedy)
    if np.shape(initial_weight) not in ((), (plane.cells,)):
        raise InputError(f"initial_weight has the shape {np.shape(initial_weight)}: {remedy}")
    require_finite(initial_weight, "initial_weight")


def _require_numbers(name: str, values: ArrayLike, remedy: str) -> None:
    if isinstance(values, Tracer):
        return
    dtype = np.asarray(values).dtype
    if not any(jnp.issubdtype(dtype, kind) for kind in (jnp.floating, jnp.integer)):
        raise InputError(f"{name} is {values!r}: {remedy}")


def start_at(
    plane: Plane,
    hysteron: str,
    initial_weight: ArrayLike,
    x0: ArrayLike,
    z0: ArrayLike,
    initial_memory: ArrayLike | str,
    dtype: DTypeLike | None = None,
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Weights (cells,), states (cells,), input and output () at the first sample of a record."""
    path, output = input_and_output(plane, jnp.reshape(as_float(x0, "x0"), -1), z0)
    if dtype is not None:
        path, output = path.astype(dtype), output.astype(dtype)
    path, states = path_and_start(plane, path, initial_memory, hysteron)
    x = path[0]
    states = hysteron_step(plane, states, x, x, hysteron)
    weights = jnp.broadcast_to(jnp.asarray(initial_weight, x.dtype), states.shape)
    return weights, states, x, output[0]


def input_and_output(
    plane: Plane, x: ArrayLike, z: ArrayLike | None
) -> tuple[jax.Array, jax.Array]:
    """Input and measured output (time,) of a record, checked, and of one floating type."""
    require_plane(plane)
    if np.size(x) > MOST_SAMPLES:
        raise InputError(f"there are {np.size(x)} samples: give them in parts, each with its state")
    x = as_signal(x, "the input x")
    if z is None:
        raise InputError(
            f"the input x has the shape {x.shape}, and there is no output z: give both, (time,)"
        )
    z = as_signal(z, "the output z")
    if x.ndim == 1 and z.ndim == 0:
        z = z.reshape(-1)
    if x.ndim != 1 or x.shape != z.shape or x.shape[0] == 0:
        several = ", and several records one by one with jax.vmap or run_fleet"
        several = several if x.ndim == z.ndim == 2 else ""
        raise InputError(
            f"the input x has the shape {x.shape} and the output z {z.shape}: "
            f"give both (time,), with time > 0{several}"
        )
    require_on_plane(plane, x)
    require_finite(z, "the output z", missing=True)
    dtype = jnp.result_type(x, z)
    return x.astype(dtype), z.astype(dtype)
