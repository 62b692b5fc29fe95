"""Switching events: which relays of a plane switch, and at which sample."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from preisach_jax.operator.cells import flat_index
from preisach_jax.operator.plane import Plane


class Switching(eqx.Module):
    """The switching events of a plane's relays along an input (a pytree).

    An event is a sample at which the input passes `width` thresholds or fewer, all in one
    direction. Its crossing c switches, upward, the cells (line, j) of a row with first ≤ j < last,
    and downward the cells (i, line) of a column with first ≤ i < last. Where there is no event or
    crossing, first = last; such events have the sample `time`.

    Attributes:
        sample: (events,) index of the sample of each event.
        rising: (events,) whether relays switch on there (S⁺), or off (S⁻).
        line: (events, width) α index of a row, or β index of a column.
        first: (events, width) first cell on the line.
        last: (events, width) cell after the last one on the line.
    """

    sample: jax.Array
    rising: jax.Array
    line: jax.Array
    first: jax.Array
    last: jax.Array

    @property
    def area(self) -> jax.Array:
        """(events,) A(k), eq. (11): how many relays switch; 0 where there is no event."""
        return jnp.sum(self.last - self.first, axis=-1)

    @property
    def sign(self) -> jax.Array:
        """(events,) +1 where relays switch on, -1 where they switch off."""
        return jnp.where(self.rising, 1, -1)

    def cells(self, plane: Plane) -> jax.Array:
        """Flat indices of the relays that switch.

        Arguments:
            plane: the Preisach plane that the events are of.

        Returns:
            (events, width · levels) indices; `plane.cells`, which is out of range, as a filling.
        """
        steps = jnp.arange(plane.levels).reshape((1,) * self.first.ndim + (-1,))
        line, last = jnp.expand_dims(self.line, -1), jnp.expand_dims(self.last, -1)
        along = jnp.expand_dims(self.first, -1) + steps
        rising = jnp.expand_dims(self.rising, (-1, -2))
        flat = jnp.where(rising, flat_index(line, along), flat_index(along, line))
        flat = jnp.where(along < last, flat, plane.cells)
        return flat.reshape(*self.sample.shape, -1)
