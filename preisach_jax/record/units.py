"""Units in column names, and what the units of time are worth in seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence

# Units that a name may end in after an underscore. A unit in brackets may be anything.
_SUFFIXES = frozenset(
    "s ms us µs μs ns min h hr "
    "V mV uV µV kV A mA uA µA kA W mW kW C Hz kHz MHz "
    "m mm um µm μm nm pm cm km in rad mrad urad µrad deg "
    "N mN uN µN kN MN Nm mNm kNm Pa kPa MPa GPa bar mbar psi kg g mg "
    "T mT uT µT nT G kG Oe kOe Wb mWb emu memu Am2 Am² A·m² A·m2 kA·m² "
    "A/m kA/m V/m kV/m V/s m/s mm/s um/s µm/s m/s2 g/s "
    "A_per_m kA_per_m V_per_m kV_per_m V_per_s m_per_s mm_per_s um_per_s A_m kA_m "
    "degC °C degF K mK % pct ppm ppb dB Ah mAh A.h mA.h A·h mA·h Ohm kOhm kip".split()
)

# Loggers that write capitals only: `TIME_MS` must not be read as seconds.
_CAPITAL_TIMES = frozenset({"S", "MS", "US", "MIN"})

_BRACKETED = re.compile(r"^(?P<name>.*?)[\s_]*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]\s*$")
_SPELLED = re.compile(r"^(?P<name>.+?)(?:\s+in\s+|\s*/\s*)(?P<unit>\S+)$")

_BY_COMMA = re.compile(r"^(?P<name>.+?),\s*(?P<unit>\S+)$")
_OF_SUFFIXES = {unit.lower(): unit for unit in _SUFFIXES}

# Exact factors as (multiplier, divisor): 7 ms is 7/1000 s to the last bit, 7 * 0.001 is not.
_SECONDS = {
    "s": (1.0, 1.0),
    "ms": (1.0, 1e3),
    "us": (1.0, 1e6),
    "ns": (1.0, 1e9),
    "min": (60.0, 1.0),
    "h": (3600.0, 1.0),
    "d": (86400.0, 1.0),
}
_SPELLINGS = {
    "sec": "s",
    "secs": "s",
    "second": "s",
    "seconds": "s",
    "sek": "s",
    "sekunden": "s",
    "msec": "ms",
    "µs": "us",
    "μs": "us",
    "usec": "us",
    "minutes": "min",
    "minuten": "min",
    "hr": "h",
    "hours": "h",
    "std": "h",
    "day": "d",
    "days": "d",
    "tage": "d",
}

TIME_UNITS = "s, ms, us, ns, min, h, d"

# Units as instruments spell them in a row of their own.
_WORDS = {
    "second": "s", "seconds": "s", "sec": "s", "sek": "s", "sekunden": "s",
    "volt": "V", "volts": "V", "ampere": "A", "amperes": "A", "amp": "A", "amps": "A",
    "watt": "W", "watts": "W", "newton": "N", "newtons": "N", "meter": "m", "meters": "m",
    "metre": "m", "metres": "m", "tesla": "T", "hertz": "Hz", "celsius": "degC", "kelvin": "K",
    "percent": "%", "в": "V", "мв": "mV", "а": "A", "с": "s", "сек": "s", "мс": "ms", "м": "m",
    "мм": "mm", "мкм": "um", "н": "N", "кн": "kN", "па": "Pa", "мпа": "MPa", "э": "Oe", "тл": "T",
}  # fmt: skip

# What else may stand for a unit, alone or in a product or quotient of units.
_WITHOUT_PREFIX = frozenset(
    "count counts digit digits lsb bit bits step steps px pixel pixels turn turns rev rpm div "
    "a.u. au a.u arb. arb arbitrary p.u. pu norm normalised normalized % percent ppm ppb db dbm "
    "dbv fs %fs %rh rh strain ustrain µstrain microstrain µε micron microns inch inches in ft "
    "deg ° arcsec arcmin mas °c °f degc degf k min h d day vpp vrms mvpp mvrms app arms "
    "lb lbf kgf gf psi bar mbar l gauss oersted ohm µ".split()
)
_PREFIXED = re.compile(
    r"[fpnuµμmcdhkKMGT]?(?:m|s|g|V|A|W|N|T|G|J|K|C|F|H|Ω|Ohm|ohm|eV|Hz|Pa|bar|rad|Oe|Wb|emu|mol|VA)"
)
_BETWEEN_UNITS = re.compile(r"[\s/*·.^²³√()\[\]0-9⁰¹⁻+-]+")

_LONGEST = 200
"""Characters of a name in which a unit is looked for: what is longer is no name of a quantity."""


_AGAIN = re.compile(r" \(\d+\)$")
"""What stands behind a name that another column has too."""


def split_unit(column: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit as it is written there, `""` if none."""
    column = _AGAIN.sub("", column.strip())
    if column.startswith("in ") and column[3:].strip() in _SUFFIXES:
        return "", column[3:].strip()
    if len(column) > _LONGEST:  # the time of the patterns below grows with its square
        return column, ""
    if match := _BRACKETED.match(column):
        unit = match["unit"]
        return match["name"].rstrip(" /_"), unit if unit.isascii() else plain_unit(unit)
    if (match := _SPELLED.match(column)) and match["unit"] in _SUFFIXES:
        return match["name"].rstrip(), match["unit"]
    if (match := _BY_COMMA.match(column)) and match["unit"].lower() in _WORDS | _OF_SUFFIXES:
        return match["name"].rstrip(), plain_unit(match["unit"])
    parts = column.split("_")
    for i in range(1, len(parts)):
        tail = "_".join(parts[i:])
        if tail in _SUFFIXES or (tail in _CAPITAL_TIMES and column.isupper()):
            return "_".join(parts[:i]), _as_written(tail)
    return column, ""


def _as_written(suffix: str) -> str:
    """A suffix's unit: a quotient cannot be written as one in a name with underscores."""
    if suffix in {"A_m", "kA_m"}:
        return suffix.replace("_", "/")
    return suffix.replace("_per_", "/")


def units_behind_names(names: Sequence[str]) -> dict[str, str]:
    """Units by name, where each name of a table has one behind a blank (`Time s`, `Force kN`)."""
    found: dict[str, str] = {}
    for name in names:
        quantity, _, unit = name.strip().rpartition(" ")
        if not quantity or not (unit in _SUFFIXES or ("_per_" in unit and is_known_unit(unit))):
            return {}
        found[name] = unit.replace("_per_", "/")
    return found if len(found) > 1 else {}


def is_unit(text: str) -> bool:
    """Whether `text` is a unit as it stands in a line of units below the column names."""
    text = text.strip()
    return (
        text == "-" or plain_unit(text) in _SUFFIXES or bool(re.fullmatch(r"\[.*\]|\(.*\)", text))
    )


def is_known_unit(unit: str) -> bool:
    """Whether a unit is made of units that are known, with or without a prefix."""

    def is_known(word: str) -> bool:
        return (
            word in _SUFFIXES
            or word.lower() in _WORDS
            or word.lower() in _WITHOUT_PREFIX
            or _PREFIXED.fullmatch(word) is not None
        )

    whole = unit.replace("_per_", "/").strip()
    return is_known(whole) or all(is_known(word) for word in _BETWEEN_UNITS.split(whole) if word)


def plain_unit(text: str) -> str:
    """A unit from a line of units, without brackets, and words such as `Volts` as their symbol."""
    bare = text.strip().strip("[]()").strip()
    return _WORDS.get(bare.lower(), bare)


def seconds_per(unit: str) -> tuple[float, float] | None:
    """Multiplier and divisor that make seconds of a unit of time; None if it is none."""
    unit = unit.strip().lower() or "s"
    return _SECONDS.get(_SPELLINGS.get(unit, unit))
