"""A tolerance says which errors matter."""

import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.diagnosis.tolerance import tolerance_of
from preisach_jax.quantity import in_unit

UM = {"input": "V", "output": "um"}


def record_of(stroke=50.0, unit="um"):
    return pj.Record.from_arrays(
        [0.0, 1.0, 2.0], [0.0, 1.0, 0.0], [0.0, stroke, 0.0], units={"output": unit}
    )


@pytest.mark.parametrize(
    ("text", "micrometres"),
    [("0.1%", 0.05), ("20nm", 0.02), (" 20 nm ", 0.02), ("1e-2 µm", 0.01), ("0.003mm", 3.0)],
)
def test_sizes_are_read(text, micrometres):
    assert tolerance_of(text, record_of()) == pytest.approx(micrometres)


def test_none_is_zero():
    assert tolerance_of(None, record_of()) == 0.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0.1", "'0.1' has no unit"),
        ("20 V", "is in V"),
        ("100%", "not below the stroke of 50 µm"),
        ("1 m", "not below the stroke"),
        ("-3nm", "no positive number"),
        ("0%", "no positive number"),
        ("much", "no positive number"),
        ("1.2.3%", "no positive number"),
        ("", "no positive number"),
    ],
)
def test_other_texts_are_refused_with_what_to_give(text, said):
    with pytest.raises(pj.InputError, match=r"0\.1%") as caught:
        tolerance_of(text, record_of())
    assert said in str(caught.value)


def test_units_that_differ_in_their_prefix():
    assert in_unit("kN", "N") == 1000.0
    assert in_unit("N", "m") is None
    assert in_unit("counts", "um") is None


@pytest.fixture(scope="module")
def measured():
    made = world.hidden_record("output_lag", 321, 6.0, 500.0)
    return pj.Record.from_arrays(made["t"], made["x"], made["z"], units=UM)


def test_an_effect_below_the_tolerance_is_told_and_not_named(measured):
    asked = ["output_lag", "drift"]
    named = pj.diagnose(measured, asked, levels=9)
    assert named.effects == ("output_lag",)
    first, last = (rung.rms_validation for rung in (named.ladder[0], named.ladder[-1]))
    made = np.sqrt(first**2 - last**2)
    loose = pj.diagnose(measured, asked, levels=9, tolerance=f"{1.5 * made:.4f} um")
    assert loose.effects == ()
    assert loose.verdict == "adequate"
    assert "within the tolerance" in loose.sentence
    (lag,) = [each for each in loose.candidates if each.effect == "output_lag"]
    assert "within the tolerance" in lag.why_not
    assert not lag.accepted
    tight = pj.diagnose(measured, asked, levels=9, tolerance=f"{0.5 * made:.4f} um")
    assert tight.effects == ("output_lag",)


def test_the_verdict_says_its_size_in_per_cent_of_the_stroke(measured):
    found = pj.diagnose(measured, ["hum"], levels=9)
    share = 100 * found.ladder[-1].rms_validation / np.ptp(measured.output)
    assert f"({share:.2g} % of the stroke)" in found.sentence


def test_on_the_command_line_a_tolerance_without_unit_is_a_users_mistake(
    measured, tmp_path, capsys
):
    rows = np.stack([measured.time, measured.input, measured.output], axis=1)
    head = "t_s,u_V,z_um"
    np.savetxt(tmp_path / "stage.csv", rows, delimiter=",", header=head, comments="")
    arguments = ["diagnose", str(tmp_path / "stage.csv"), "--report", str(tmp_path / "report")]
    assert main([*arguments, "--tolerance", "0.1"]) == 2
    error = capsys.readouterr().err
    assert "has no unit" in error
    assert "Traceback" not in error
    assert not (tmp_path / "report" / "diagnosis.json").exists()
