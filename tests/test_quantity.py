"""Numbers with units: the same quantity, in a prefix that reads well."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from preisach_jax.quantity import change, interval, quantity, scaled

PREFIXES = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}


@given(st.floats(1e-11, 1e8), st.sampled_from(["nV", "uV", "µV", "mV", "V", "kV"]))
def test_scaling_keeps_the_quantity_and_gives_one_to_three_digits(value, unit):
    factor, shown = scaled(value, unit)
    before = value * PREFIXES[unit[:-1].replace("u", "µ")]
    after = factor * value * PREFIXES[shown.removesuffix("V")]
    assert after == pytest.approx(before, rel=1e-9)
    if 1e-12 <= before < 1e12:
        assert 0.99994 < factor * value < 1000.0


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1.234e-5, "A·m²", "12.34 µA·m²"), (0.99999, "um", "1 µm"), (12_000.0, "s", "12000 s"),
        (0.0, "um", "0 µm"), (-0.002, "V", "-2 mV"), (0.25, "1", "0.25"), (5.0, "min", "5 min"),
        (0.001, "um/N", "0.001 µm/N"), (math.nan, "um", "unknown"), (math.inf, "s", "∞ s"),
    ],
)  # fmt: skip
def test_quantities_read_as_a_person_writes_them(value, unit, text):
    assert quantity(value, unit) == text


def test_an_interval_has_one_unit():
    assert interval(999e-9, 998e-9, 1002e-9, "m") == "999 nm (95 %: 998 to 1002)"
    assert interval(0.02, -math.inf, math.inf, "1") == "0.02 (95 %: -∞ to ∞)"
    assert interval(0.0, 0.0, 0.5, "1") == "0 (95 %: 0 to 0.5)"


@pytest.mark.parametrize(
    ("percent", "digits", "text"),
    [(-12.34, 1, "−12.3 %"), (12.34, 0, "+12 %"), (-0.04, 1, "0.0 %"), (0.2, 0, "0 %")],
)
def test_a_change_that_is_rounded_to_nothing_has_no_sign(percent, digits, text):
    assert change(percent, digits) == text
