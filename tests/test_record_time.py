"""Times as dates, clock times and seconds since 1970."""

from datetime import UTC, datetime, timedelta, timezone
from decimal import Decimal

import numpy as np
import pytest

from preisach_jax.errors import InputError
from preisach_jax.record.core import Record

K = 60
STEP = timedelta(milliseconds=25)
START = datetime(2024, 3, 1, 12, 0, 0, 125_000)
MOMENTS = [START + k * STEP for k in range(K)]
# Quotients of whole numbers, and so right to the last bit.
SECONDS = np.arange(K) * 25 / 1000
INPUT = [f"{(k * 7) % 13}.5" for k in range(K)]


def load(folder, times, name="time"):
    """The record with these times, and what is announced of it."""
    path = folder / "stage.csv"
    rows = [f"{t};{u};{u}1" for t, u in zip(times, INPUT, strict=True)]
    path.write_text("\n".join([f"{name};u_V;z_um", *rows]) + "\n", encoding="utf-8")
    notes = []
    return Record.load(path, announce=notes.append), " ".join(notes)


# Since 1970


@pytest.mark.parametrize(
    ("name", "digits", "factor"),
    [("t_s", 6, 1), ("t_ms", 3, 10**3), ("t_us", 0, 10**6), ("t_ns", 0, 10**9)],
)
def test_seconds_since_1970_keep_their_steps(tmp_path, name, digits, factor):
    nanoseconds = [1_709_294_400_125_000_000 + 25_000_000 * k for k in range(K)]
    cells = [str(Decimal(each * factor).scaleb(-9).quantize(Decimal(10) ** -digits))
             for each in nanoseconds]  # fmt: skip
    record, notes = load(tmp_path, cells, name)
    np.testing.assert_array_equal(record.time, SECONDS)
    assert record.time_values[0] == float(cells[0])
    assert "so time counts from the first row" in notes


def test_a_clock_that_counts_from_elsewhere_is_left_alone(tmp_path):
    record, notes = load(tmp_path, [f"{86_400 * 365 + k}" for k in range(K)], "t_s")
    assert record.time[0] == 86_400 * 365
    assert "first row" not in notes


# Dates and clock times

FORMATS = {
    "2024-03-01 12:00:00.125": lambda m: m.isoformat(" ", "milliseconds"),
    "2024-03-01T12:00:00.125Z": lambda m: m.isoformat("T", "milliseconds") + "Z",
    "2024/03/01 12:00:00.125": lambda m: m.strftime("%Y/%m/%d %H:%M:%S.%f"),
    "01.03.2024 12:00:00,125": lambda m: m.strftime("%d.%m.%Y %H:%M:%S,%f")[:-3],
    "03/01/2024 12:00:00.125": lambda m: m.strftime("%m/%d/%Y %H:%M:%S.%f")[:-3],
    "12:00:00.125": lambda m: m.strftime("%H:%M:%S.%f")[:-3],
}


@pytest.mark.parametrize("example", FORMATS)
def test_dates_and_clock_times_become_seconds_from_the_first_row(tmp_path, example):
    cells = [FORMATS[example](moment) for moment in MOMENTS]
    assert cells[0].startswith(example)
    record, notes = load(tmp_path, cells)
    np.testing.assert_array_equal(record.time, SECONDS)
    assert record.channels["time"].unit == "s"
    assert "column time read as time from its first row" in notes


def test_a_clock_goes_on_behind_midnight_and_says_so(tmp_path):
    moments = [datetime(2024, 1, 1, 23, 59, 59) + k * STEP for k in range(K)]
    record, notes = load(tmp_path, [m.strftime("%H:%M:%S.%f") for m in moments])
    np.testing.assert_array_equal(record.time, SECONDS)
    assert "clock times that run past midnight" in notes


def test_offsets_from_universal_time_are_taken_off(tmp_path):
    zones = [timezone(timedelta(hours=k % 3 - 1, minutes=30 * (k % 2))) for k in range(K)]
    moments = [m.replace(tzinfo=UTC).astimezone(z) for m, z in zip(MOMENTS, zones, strict=True)]
    record, _ = load(tmp_path, [m.isoformat(" ", "milliseconds") for m in moments])
    np.testing.assert_array_equal(record.time, SECONDS)


@pytest.mark.parametrize(
    ("pattern", "start", "expected"),
    [
        ("%d.%m.%Y", datetime(2024, 3, 11, 23, 59, 30), "day first, as is usual with points"),
        ("%d/%m/%Y", datetime(2024, 3, 11, 23, 59, 30), "day first, by which the record is sho"),
        ("%m/%d/%Y", datetime(2024, 3, 11, 23, 59, 30), "month first, by which the record is s"),
        ("%d/%m/%Y", datetime(2024, 3, 12, 23, 59, 30), ""),  # the 13th is no month
        ("%d/%m/%Y", datetime(2024, 3, 11, 12), ""),  # one day, whichever it is
    ],
)
def test_whether_day_or_month_comes_first_is_told_by_evidence(tmp_path, pattern, start, expected):
    moments = [start + timedelta(seconds=k) for k in range(K)]
    record, notes = load(tmp_path, [m.strftime(f"{pattern} %H:%M:%S") for m in moments])
    np.testing.assert_array_equal(record.time, np.arange(K))
    assert expected in notes
    assert ("first," in notes) == bool(expected)


@pytest.mark.parametrize(
    ("bad", "told"),
    [
        ("2024-02-30 12:00:00", "'2024-02-30 12:00:00' is not a num"),
        ("later", "'later' is not a num"),
        ("", "the cell is empty"),
    ],
)
def test_a_cell_that_is_no_time_like_the_others_is_named(tmp_path, bad, told):
    cells = [m.isoformat(" ", "milliseconds") for m in MOMENTS]
    cells[15] = bad
    with pytest.raises(InputError, match=rf"stage.csv, column time, row 17: {told}"):
        load(tmp_path, cells)
