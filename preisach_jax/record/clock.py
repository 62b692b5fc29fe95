"""Times written as dates or clock times, made seconds from the first row.

`pandas.to_datetime` guesses the order of day and month row by row and does not carry clock times
past midnight; here one order holds for a whole column, and each refusal names the row.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np

from preisach_jax.record.marks import spans

_TIME = r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?:[.,](?P<part>\d{1,9})\d*)?)?"
_TIME += r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
_ZONE = r"\s*(?P<zone>Z|[+-]\d{2}:?\d{2})?"
_YEAR_FIRST = re.compile(
    rf"(?P<year>\d{{4}})[-/.](?P<a>\d{{1,2}})[-/.](?P<b>\d{{1,2}})(?:\s+|T){_TIME}{_ZONE}"
)
_YEAR_LAST = re.compile(
    rf"(?P<a>\d{{1,2}})(?P<sign>[./-])(?P<b>\d{{1,2}})[./-](?P<year>\d{{4}}),?\s+{_TIME}{_ZONE}"
)
_CLOCK = re.compile(_TIME)
_LOOKED_AT = 20  # cells by which a column is known
_SECOND = 10**9  # ns
_DAY = 24 * 3600 * _SECOND
_LEAST_EQUAL, _LONGEST_EQUAL = 3, 50  # runs of equal times, and their rows, in a rounded clock


def clock_seconds(cells: np.ndarray) -> tuple[np.ndarray, str] | None:
    """Seconds from the first row, where a column holds dates with times, or clock times.

    Understood are `2024-03-01 12:00:00.125`, with T, Z or an offset such as +01:00, day or month
    first as in `01.03.2024 12:00:00,125`, and `12:00:00.125`, each with AM or PM too.
    Whether the day or the month comes first is told by numbers above 12, else by which order makes
    the record shorter.
    """
    filled = [cell for cell in cells if isinstance(cell, str) and cell.strip()]
    pattern = _pattern(filled[:_LOOKED_AT])
    if pattern is None:
        return None
    matches = [pattern.fullmatch(cell.strip()) if isinstance(cell, str) else None for cell in cells]
    ticks, assumed = _ticks(matches, pattern)
    if all(tick is None for tick in ticks):
        return None
    if pattern is _CLOCK:
        ticks, assumed = _unrolled(ticks)
    first = next(tick for tick in ticks if tick is not None)
    seconds = [
        cell if tick is None else (tick - first) / _SECOND
        for cell, tick in zip(cells, ticks, strict=True)
    ]
    if any(isinstance(value, str) and value.strip() for value in seconds):
        return np.array(seconds, dtype=object), assumed
    numbers = [np.nan if isinstance(value, str) else value for value in seconds]
    return np.array(numbers, dtype=np.float64), assumed


def is_time(text: str) -> bool:
    """Whether a text is a date with a time, or a time of day."""
    return any(p.fullmatch(text.strip()) for p in (_YEAR_FIRST, _YEAR_LAST, _CLOCK))


def _pattern(sample: Sequence[str]) -> re.Pattern[str] | None:
    for pattern in (_YEAR_FIRST, _YEAR_LAST, _CLOCK):
        if sample and pattern.fullmatch(sample[0].strip()):
            alike = sum(pattern.fullmatch(cell.strip()) is not None for cell in sample)
            return pattern if 2 * alike > len(sample) else None
    return None


def _ticks(
    matches: Sequence[re.Match[str] | None], pattern: re.Pattern[str]
) -> tuple[list[int | None], str]:
    """Nanoseconds on a common scale, None where there is no time, and what was assumed."""
    times = [None if match is None else _time_of_day(match) for match in matches]
    if pattern is _CLOCK:
        return times, ""
    if pattern is _YEAR_FIRST:
        return _dated(matches, times, "month", "day"), ""
    orders = {"day": ("day", "month"), "month": ("month", "day")}
    readings = {first: _dated(matches, times, *order) for first, order in orders.items()}
    count = {first: sum(t is not None for t in ticks) for first, ticks in readings.items()}
    if count["day"] != count["month"]:
        return readings[max(count, key=count.__getitem__)], ""
    # Points between the numbers are the custom of countries that write the day first.
    if next(match for match in matches if match)["sign"] == ".":
        return readings["day"], "dates with the day first, as is usual with points"
    spans = {first: _span(ticks) for first, ticks in readings.items()}
    if spans["day"] == spans["month"]:
        return readings["day"], ""  # one day, whichever it is
    shorter = min(spans, key=spans.__getitem__)
    return readings[shorter], f"dates with the {shorter} first, by which the record is shorter"


def _time_of_day(match: re.Match[str]) -> int | None:
    hour, minute, second = (int(match[name] or 0) for name in ("hour", "minute", "second"))
    if match["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + 12 * (match["half"] in "Pp")
    if hour > 23 or minute > 59 or second > 60:  # 60 is a leap second
        return None
    whole = (hour * 3600 + minute * 60 + second) * _SECOND
    return whole + int((match["part"] or "").ljust(9, "0"))


def _dated(
    matches: Sequence[re.Match[str] | None], times: Sequence[int | None], first: str, second: str
) -> list[int | None]:
    """Nanoseconds, where the numbers beside the year mean `first` and `second`."""
    days: dict[tuple[str, str, str], int | None] = {}
    ticks: list[int | None] = []
    for match, time in zip(matches, times, strict=True):
        if match is None or time is None:
            ticks.append(None)
            continue
        key = (match["year"], match["a"], match["b"])
        if key not in days:
            days[key] = _day_number(int(key[0]), **{first: int(key[1]), second: int(key[2])})
        day = days[key]
        ticks.append(None if day is None else day * _DAY + time - _zone(match["zone"]))
    return ticks


def _day_number(year: int, month: int, day: int) -> int | None:
    try:
        return date(year, month, day).toordinal()
    except ValueError:
        return None


def _zone(text: str | None) -> int:
    """Nanoseconds by which a clock is ahead of universal time; no zone counts as none."""
    if text is None or text == "Z":
        return 0
    ahead = int(text[1:3]) * 3600 + int(text[-2:]) * 60
    return (-ahead if text[0] == "-" else ahead) * _SECOND


def _span(ticks: Sequence[int | None]) -> int:
    known = [tick for tick in ticks if tick is not None]
    return max(known) - min(known) if known else 0


def _unrolled(ticks: Sequence[int | None]) -> tuple[list[int | None], str]:
    """The same with a day more wherever the clock starts anew, and whether it does."""
    days, before = 0, None
    unrolled: list[int | None] = []
    for tick in ticks:
        if tick is not None:
            days += before is not None and before - tick > _DAY // 2
            before = tick
        unrolled.append(None if tick is None else tick + days * _DAY)
    return unrolled, "clock times that run past midnight" if days else ""


def is_rounded(seconds: np.ndarray) -> bool:
    """Whether times never run back and stand still in many short runs, as rounded ones do."""
    steps = np.diff(seconds)
    if not np.isfinite(seconds).all() or np.any(steps < 0) or np.sum(steps == 0) < _LEAST_EQUAL:
        return False
    lengths = [stop - start for start, stop in spans(steps == 0)]
    return len(lengths) >= _LEAST_EQUAL and max(lengths) <= _LONGEST_EQUAL


def evenly_spread(seconds: np.ndarray) -> np.ndarray:
    """Rows of one rounded time, evenly up to the next one; the last ones as far apart as usual.

    Times that are not rounded come back as they are.
    """
    if not is_rounded(seconds):
        return seconds
    first = np.flatnonzero(np.diff(seconds, prepend=-np.inf) > 0)
    usual = float(seconds[-1] - seconds[0]) / (first[-1] - first[0])
    ends = np.append(first, len(seconds))
    at = np.append(seconds[first], seconds[-1] + usual * (len(seconds) - first[-1]))
    return np.interp(np.arange(len(seconds)), ends, at)
