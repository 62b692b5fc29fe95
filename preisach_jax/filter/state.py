"""What the adaptive filter carries from sample to sample, records of each, and returns."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax


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
