"""Numbers with units as a person reads them: 17.2 nm, not 1.72e-08 m."""

from __future__ import annotations

import math
import re

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_EXPONENTS = {prefix: exponent for exponent, prefix in _PREFIXES.items()} | {"u": -6, "μ": -6}

# Units that take prefixes; longer ones first, so that `mN` is not read as `m` and `N`.
_SCALABLE = "A·m² A·m2 Am² Am2 A/m V/m V/s m/s Hz Pa Nm rad emu Oe Wb m s V A W N T g G".split()


def scaled(magnitude: float, unit: str) -> tuple[float, str]:
    """The factor and the unit in which values of a magnitude read best.

    Arguments:
        magnitude: the largest absolute value to be shown, in `unit`.
        unit: unit as in the file, `""` if unknown.

    Returns:
        What to multiply values by, and the unit that they then have; 1 and the unit itself where
        it takes no prefix.
    """
    parsed = _prefix_and_base(unit)
    if parsed is None or not 0 < abs(magnitude) < math.inf:
        return 1.0, pretty_unit(unit)
    prefix, base = parsed
    given = _EXPONENTS[prefix]
    # Rounded to the digits that are shown, so that 999.96 nm becomes 1 µm and not 1000 nm.
    wanted = 3 * math.floor((math.log10(float(f"{abs(magnitude):.4g}")) + given) / 3 + 1e-12)
    highest = 0 if base == "s" else 9
    wanted = min(max(wanted, -12), highest)
    return 10.0 ** (given - wanted), _PREFIXES[wanted] + base


def in_unit(given: str, unit: str) -> float | None:
    """What one of a unit is in another that differs from it in its prefix; None if it does not."""
    if pretty_unit(given) == pretty_unit(unit):
        return 1.0
    one, other = _prefix_and_base(given), _prefix_and_base(unit)
    if one is None or other is None or one[1] != other[1]:
        return None
    return float(f"1e{_EXPONENTS[one[0]] - _EXPONENTS[other[0]]}")


def pretty_unit(unit: str) -> str:
    """A unit with µ for u, and nothing for the unit one."""
    if unit in {"1", "-"}:
        return ""
    return re.sub(r"(?<![A-Za-z])u(?=(?:m|s|V|A|N|T|W|g|rad|Oe|emu)(?![A-Za-z]))", "µ", unit)


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A value with its unit, in the prefix that reads best.

    Arguments:
        unit: unit of the value as in the file, `""` if unknown.
    """
    if math.isnan(value):
        return "unknown"
    # Rounded first, so that 999.6 pm in two digits is 1 nm and not 1000 pm.
    factor, shown = scaled(float(f"{value:.{digits}g}"), unit)
    return f"{number(factor * value, digits)} {shown}".rstrip()


def number(value: float, digits: int = 4) -> str:
    """A value without unit to some significant digits."""
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if math.isnan(value):
        return "unknown"
    if 1e4 <= abs(value) < 1e7:
        return f"{value:.0f}"
    rounded = f"{value:.{digits}g}"
    return f"{float(rounded):.0f}" if "e+" in rounded and abs(value) < 1e4 else rounded


def change(percent: float, digits: int = 0) -> str:
    """A change in per cent with its sign; none where it is rounded to nothing."""
    text = f"{percent:+.{digits}f} %"
    return text[1:] if float(text[:-2]) == 0 else text.replace("-", "−")


def interval(value: float, low: float, high: float, unit: str, digits: int = 4) -> str:
    """A value with its 95 % interval, all in one unit."""
    factor, shown = scaled(value, unit)
    numbers = [number(factor * x, digits) for x in (value, low, high)]
    unit_part = f" {shown}" if shown else ""
    return f"{numbers[0]}{unit_part} (95 %: {numbers[1]} to {numbers[2]})"


def _prefix_and_base(unit: str) -> tuple[str, str] | None:
    for base in _SCALABLE:
        if unit.endswith(base):
            prefix = unit[: -len(base)]
            return (prefix, base) if prefix in _EXPONENTS else None
    return None
