"""What an unknown past costs a prediction, in words."""

from __future__ import annotations

import numpy as np

from preisach_jax.model.core import Model
from preisach_jax.model.estimates import Prediction
from preisach_jax.quantity import pretty_unit, quantity
from preisach_jax.record import Record

TOLD = 0.5
"""Part of the half width with a known past from which on what an unknown one adds is told."""


def past_sentence(model: Model, record: Record, prediction: Prediction) -> str:
    """Why a band is wider than that of a known past, for how long, and what narrows it."""
    known = model.half_width(record)
    added = (prediction.high - prediction.low) / 2 - known
    wide = np.flatnonzero(added > TOLD * known)
    if not len(wide):
        return ""
    unit, last = model.units.get("output", ""), int(wide[-1])
    plane, in_unit = model.plane, pretty_unit(model.units.get("input", ""))
    widest = int(np.argmax(added))
    until = "to the last row"
    if last + 1 < len(record):
        after = float(record.time[last + 1] - record.time[0])
        until = f"until row {last + 2:,}, {quantity(after, 's')} after the first"
    span = f"{plane.low:.6g} to {plane.high:.6g} {in_unit}".rstrip()
    return (
        "what the input did before row 1 is not known, so that the band is wider, by up to "
        f"±{quantity(float(added[widest]), unit, 3)} (with a known past it is "
        f"±{quantity(float(known[widest]), unit, 3)}), {until}; to narrow it, begin the record "
        f"with a sweep over the whole range ({span}), or say --initial-memory low, high, "
        f"demagnetised or as-fitted, or record without a pause behind {model.origin.record}, on "
        "its clock"
    )
