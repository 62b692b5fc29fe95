"""Units of magnetic field and induction, and what energy a loop between them has."""

from __future__ import annotations

import math
from dataclasses import dataclass

from preisach_jax.errors import InputError
from preisach_jax.quantity import pretty_unit
from preisach_jax.record import Record
from preisach_jax.record.units import split_unit

MU_0 = 4e-7 * math.pi
"""Magnetic constant, in T m/A; it differs from the measured one by 2e-10."""

FIELD_UNITS = {
    "A/m": 1.0, "kA/m": 1e3, "MA/m": 1e6, "mA/m": 1e-3, "A/cm": 1e2, "A/mm": 1e3,
    "Oe": 1e3 / (4 * math.pi), "kOe": 1e6 / (4 * math.pi), "mOe": 1 / (4 * math.pi),
}  # fmt: skip
"""What one of a unit of H is in A/m."""

INDUCTION_UNITS = {
    "T": 1.0, "mT": 1e-3, "uT": 1e-6, "µT": 1e-6, "nT": 1e-9, "G": 1e-4, "kG": 1e-1, "mG": 1e-7,
    "Wb/m2": 1.0, "Wb/m²": 1.0, "Vs/m2": 1.0, "Vs/m²": 1.0,
}  # fmt: skip
"""What one of a unit of B is in T."""

JOULES = "J/m3"


@dataclass(frozen=True)
class Magnet:
    """Which signal of a record is the field.

    Attributes:
        field: `"input"` or `"output"`; the other one is the induction.
        joules: energy in J/m³ of a loop whose area in input unit times output unit is one.
    """

    field: str
    joules: float


def magnet_of(record: Record) -> Magnet | None:
    r"""The field and the induction of a record by their units, or None if it is of no magnet.

    The field is in A/m, Oe and their multiples, or as \(\mu_0 H\) in units of the induction, if
    its name then begins with H or has mu0H in it. The induction is in T, G and their multiples.

    Returns:
        Which signal is the field, and the energy that a unit of area has.
    """
    units = {role: record.channels[role].unit for role in ("input", "output")}
    inductions = [role for role, unit in units.items() if unit in INDUCTION_UNITS]
    fields = [role for role, unit in units.items() if unit in FIELD_UNITS]
    if len(inductions) == 2:
        fields = [role for role in inductions if _is_field(record.channels[role].name)]
        inductions = [role for role in inductions if role not in fields]
    if len(fields) != 1 or len(inductions) != 1:
        return None
    (field,), (induction,) = fields, inductions
    unit = units[field]
    amperes = FIELD_UNITS[unit] if unit in FIELD_UNITS else INDUCTION_UNITS[unit] / MU_0
    # A product first: 1000 times 0.001 is 1 to the last bit.
    return Magnet(field, amperes * INDUCTION_UNITS[units[induction]])


def _is_field(name: str) -> bool:
    quantity = split_unit(name)[0].strip().lower().replace("μ", "u").replace("µ", "u")
    return quantity.startswith("h") or any(word in quantity for word in ("mu0h", "mu0_h", "u0h"))


def area_unit(record: Record) -> str:
    """Unit of the area of a loop of a record that is of no magnet."""
    units = [pretty_unit(record.channels[role].unit) for role in ("input", "output")]
    if not all(units):
        given = ", ".join(f"{role} {record.channels[role].unit!r}" for role in ("input", "output"))
        raise InputError(
            f"{record.name}: the units are {given}, and a loop has an energy only in units; give "
            'them, as in units={"input": "A/m", "output": "T"}'
        )
    return "·".join(units)
