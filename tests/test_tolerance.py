"""A tolerance says which errors matter."""

import numpy as np
import pytest
from found import LEVELS, found, record_of

import preisach_jax as pj
from preisach_jax.diagnosis.tolerance import tolerance_of
from preisach_jax.quantity import in_unit

UP_AND_DOWN = 30 - np.abs(np.arange(61) - 30.0)
SMALL = pj.Record.from_arrays(np.arange(61), UP_AND_DOWN, UP_AND_DOWN / 0.6, units={"output": "um"})


@pytest.mark.parametrize(
    ("text", "micrometres"),
    [(None, 0.0), ("0.1%", 0.05), (" 20 nm ", 0.02), ("1e-2 µm", 0.01), ("0.003mm", 3.0)],
)
def test_sizes_are_read(text, micrometres):
    assert tolerance_of(text, SMALL) == pytest.approx(micrometres)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0.1", "'0.1' has no unit"),
        ("20 V", "is in V"),
        ("100%", "not below the stroke of 50 µm"),
        ("1 m", "not below the stroke"),
        ("-3nm", "no positive number"),
        ("0%", "no positive number"),
        ("1.2.3%", "no positive number"),
        ("", "no positive number"),
    ],
)
def test_other_texts_are_refused_with_what_to_give(text, said):
    with pytest.raises(pj.InputError, match=r"0\.1%") as caught:
        tolerance_of(text, SMALL)
    assert said in str(caught.value)


def test_units_that_differ_in_their_prefix():
    assert in_unit("kN", "N") == 1000.0
    assert in_unit("N", "m") is None
    assert in_unit("counts", "um") is None


def test_an_effect_below_the_tolerance_is_told_and_not_named():
    named, record = found("input_lag"), record_of("input_lag")
    last = named.final.rms_validation
    made = np.sqrt(named.base.rms_validation**2 - last**2)
    assert f"({100 * last / np.ptp(record.output):.2g} % of the stroke)" in named.sentence
    for share, effects in ((1.5, ()), (0.5, ("input_lag",))):
        again = pj.diagnose(
            record, ["input_lag"], levels=LEVELS, tolerance=f"{share * made:.4f} um"
        )
        assert again.effects == effects
        (lag,) = [each for each in again.candidates if each.effect == "input_lag"][:1]
        assert lag.accepted == bool(effects)
        if not effects:
            assert again.verdict == "adequate"
            assert "within the tolerance" in again.sentence
            assert "within the tolerance" in lag.why_not
