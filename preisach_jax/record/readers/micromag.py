"""Reversal curves, loops and initial curves in the text format of MicroMag magnetometers.

A curve is measured from saturation: the field goes to `HSat` and rests there for `PauseSat`
(nothing is measured), down to a calibration field `HCal` where one point is measured against drift,
on to the reversal field, and from there upward, one point every `Averaging time`. The file holds
the measured points only, in blocks separated by blank lines; the excursions to saturation have to
be put back, or the history of the field would be wrong.

Format: C. R. Pike, A. P. Roberts and K. L. Verosub (1999), Characterizing interactions in fine
magnetic particle systems using first order reversal curves, J. Appl. Phys. 85, 6660, for the
protocol; the manual of the MicroMag 2900/3900 for the header.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.table import Table

# `HSat = +3.0E-01` in older files, `HSat    +3.0E-01` in newer ones, `Name : text` in both.
_TAG = re.compile(
    r"^\s*(?P<name>[A-Za-z][\w .?()/-]*?)\s*(?:[=:]|\s{2,}|\t)\s*(?P<value>\S.*?)\s*$"
)
_UNITS = re.compile(r"\s*\((T|Oe|A/m)\)\s+\((A\S*m\S*|emu)\)")  # of field and moment
_NEAR_ZERO = 0.02  # of the greatest field, at which an initial curve begins
_POINT = re.compile(r"^\s*[+-]?[\d.]")


@dataclass(frozen=True)
class _Block:
    """Points between two blank lines: rows of the file, fields and moments."""

    rows: list[int]
    fields: list[float]
    moments: list[float]


def is_micromag(text: str) -> bool:
    """Whether a text begins as MicroMag files do."""
    return text.lstrip().startswith("MicroMag")


def read_micromag(text: str, source: str) -> Table:
    """Read reversal curves, with the unmeasured points at saturation put back; or loops.

    A file of reversal curves has no time of each point. It follows from the protocol: a point takes
    the averaging time, a rest at saturation the pause; both are stretched alike to the elapsed time
    that the header states, which accounts for the slewing of the field.
    """
    lines = text.split("\n")
    if not any("first-order reversal curves" in line.lower() for line in lines[:5]):
        return _read_loops(lines, source)
    header, begin = _read_header(lines)
    saturation = _tag(header, "hsat", source)
    averaging = _tag(header, "averagingtime", source)
    pause = _optional(header, "pausesat") or averaging
    blocks = _read_blocks(lines, begin, source)
    measured = sum(len(block.rows) for block in blocks)
    announced = header.get("ndata")
    if announced is not None and announced.isdigit() and int(announced) != measured:
        raise InputError(
            f"{source}: the file holds {measured} points and its header announces NData = "
            f"{announced}; copy the file again, or correct NData"
        )
    calibration = _optional(header, "hcal")
    rows, fields, moments, rests = _protocol(blocks, saturation, calibration)

    duration = np.where(rests, pause, averaging)
    time = np.cumsum(duration)
    elapsed = _optional(header, "elapsedtime")
    if elapsed is not None and elapsed > 0:
        time = time / time[-1] * elapsed
    note = (
        f"{source}: {int(np.sum(rests))} unmeasured rests at saturation ({saturation:g}) put back; "
        f"time made from the protocol ({time[-1]:.6g} s in all)"
    )
    is_cgs = "cgs" in header.get("unitsofmeasure", "").lower()
    return Table(
        source,
        {"t": time, "field": fields, "moment": moments},
        rows,
        units={"t": "s", "field": "Oe" if is_cgs else "T", "moment": "emu" if is_cgs else "A·m²"},
        roles={"time": "t", "input": "field", "output": "moment"},
        makes_time=True,
        initial_memory="high" if saturation > 0 else "low",
        notes=(note,),
    )


def _read_loops(lines: list[str], source: str) -> Table:
    """Initial curves and loops, segment behind segment, without the columns that are adjusted."""
    units = [k for k, line in enumerate(lines) if _UNITS.match(line)]
    if not units:
        raise InputError(
            f"{source}, row 2: {lines[1].strip()[:60] if len(lines) > 1 else ''!r} is followed by "
            "no 'Field  Moment' with their units; of MicroMag files reversal curves, loops and "
            "initial curves can be read, save others as CSV"
        )
    header, _ = _read_header(lines[: units[0]])
    blocks = _read_blocks(lines, units[0] + 1, source)
    fields = np.array([field for block in blocks for field in block.fields])
    moments = np.array([moment for block in blocks for moment in block.moments])
    field_unit, moment_unit = re.findall(r"\(([^)]*)\)", lines[units[0]])[:2]
    is_initial = header.get("initialmagnetization?", "").lower() == "yes"
    is_demagnetised = is_initial and abs(fields[0]) <= _NEAR_ZERO * np.max(np.abs(fields))
    notes = [f"{source}: {len(blocks)} segments put one behind the other"]
    if is_demagnetised:
        notes.append(f"{source}: it begins with an initial curve, so at a demagnetised state")
    return Table(
        source,
        {"field": fields, "moment": moments},
        np.array([row for block in blocks for row in block.rows]),
        units={"field": field_unit, "moment": "A·m²" if moment_unit.startswith("A") else "emu"},
        roles={"input": "field", "output": "moment"},
        initial_memory="demagnetised" if is_demagnetised else "free",
        notes=tuple(notes),
    )


def _read_header(lines: list[str]) -> tuple[dict[str, str], int]:
    """Tags by name (lower case, without spaces), and the index of the first line of data."""
    tags: dict[str, str] = {}
    for i, line in enumerate(lines):
        if _POINT.match(line) and "," in line:
            return tags, i
        if match := _TAG.match(line):
            tags[re.sub(r"[\s.]", "", match["name"]).lower()] = match["value"]
    return tags, len(lines)


def _optional(header: dict[str, str], name: str) -> float | None:
    try:
        return float(header[name])
    except (KeyError, ValueError):
        return None


def _tag(header: dict[str, str], name: str, source: str) -> float:
    value = _optional(header, name)
    spelled = {"hsat": "HSat", "averagingtime": "Averaging time"}[name]
    if not value:
        raise InputError(
            f"{source}: the header has {spelled} = {header.get(name, 'nothing')}, so the rests at "
            "saturation cannot be put back; add it, or give the record as CSV"
        )
    return value


def _read_blocks(lines: list[str], begin: int, source: str) -> list[_Block]:
    """The blocks of points from line `begin` on."""
    blocks = [_Block([], [], [])]
    for i, line in enumerate(lines[begin:], start=begin + 1):
        if not line.strip():
            if blocks[-1].rows:
                blocks.append(_Block([], [], []))
            continue
        if line.startswith("MicroMag"):
            break
        parts = line.split(",")
        for value, into, name in zip(
            parts, (blocks[-1].fields, blocks[-1].moments), ("field", "moment"), strict=False
        ):
            try:
                into.append(float(value))
            except ValueError:
                raise InputError(
                    f"{source}, column {name}, row {i}: {value.strip()[:60]!r} is not a number; "
                    "correct or remove the row"
                ) from None
        if len(parts) < 2:
            raise InputError(
                f"{source}, column moment, row {i}: {line.strip()[:60]!r} has no moment; correct "
                "or remove the row"
            )
        blocks[-1].rows.append(i)
    blocks = [block for block in blocks if block.rows]
    if not blocks:
        raise InputError(f"{source}: the file holds no points; copy it again")
    return blocks


def _protocol(
    blocks: list[_Block], saturation: float, calibration: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows, fields, moments and whether a point is a rest at saturation, in order of time."""
    rows: list[int] = []
    fields: list[float] = []
    moments: list[float] = []
    rests: list[bool] = []
    is_saturated = False
    for i, block in enumerate(blocks):
        if not is_saturated:
            # The rest stands in no row: messages name that of the first point after it.
            rows.append(block.rows[0])
            fields.append(saturation)
            moments.append(np.nan)
            rests.append(True)
        rows += block.rows
        fields += block.fields
        moments += block.moments
        rests += [False] * len(block.rows)
        # From the calibration point the field goes on to the reversal field, not to saturation.
        is_saturated = (
            calibration is not None
            and len(block.rows) == 1
            and i + 1 < len(blocks)
            and not is_saturated
            and abs(block.fields[0] - calibration) <= 0.05 * abs(saturation)
        )
    return np.array(rows), np.array(fields), np.array(moments), np.array(rests)
