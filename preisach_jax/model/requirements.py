"""What a model asks of a record along which it predicts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from preisach_jax.chain import Chain
from preisach_jax.effects.of_column import OfColumn
from preisach_jax.errors import InputError
from preisach_jax.quantity import pretty_unit
from preisach_jax.record import Record

RANGE_TOLERANCE = 0.01
"""Share of the input range by which an input may leave the plane: noise of a converter does."""


def check_record(chain: Chain, units: Mapping[str, str], record: Record) -> None:
    """Ask whether a model can predict along a record.

    Arguments:
        units: units of the model by role.
    """
    _check_units(units, record)
    if chain.mechanics:
        return  # the plane is one of displacements, and `moved` asks whether they stay on it
    plane = chain.plane
    reach = RANGE_TOLERANCE * (plane.high - plane.low)
    beyond = np.flatnonzero(
        (record.input < plane.low - reach) | (record.input > plane.high + reach)
    )
    if len(beyond):
        row = int(beyond[0])
        unit = units.get("input", "")
        raise InputError(
            f"{record.name}: the input {record.input[row]:.6g} {unit} in sample {row + 1} lies "
            f"outside the range {plane.low:.6g} to {plane.high:.6g} {unit} on which the model "
            f"was identified ({len(beyond)} such samples); identify a model on a record that "
            "covers it, or cut these samples out"
        )
    for effect in chain.effects:
        if isinstance(effect, OfColumn) and effect.column not in record.aux:
            raise InputError(
                f"{record.name}: the model needs the auxiliary column {effect.column!r}; "
                f"load the record with it (--aux {effect.column})"
            )


def _check_units(units: Mapping[str, str], record: Record) -> None:
    for role in ("input", "output", *record.aux):
        own, given = (
            pretty_unit(unit) for unit in (units.get(role, ""), record.channels[role].unit)
        )
        if own and given and own != given:
            raise InputError(
                f"{record.name}, column {record.channels[role].name}: its unit is {given}, and "
                f"the model was identified in {own}; convert the column, or fit a model to it"
            )
