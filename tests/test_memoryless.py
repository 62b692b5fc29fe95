"""Below the Preisach model stand a straight line and a curve: is there hysteresis at all?"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from oracles import play

import preisach_jax as pj
from preisach_jax.diagnosis.memoryless import memoryless
from preisach_jax.diagnosis.wording import sentence
from preisach_jax.plot.diagnosis import waterfall
from preisach_jax.present import diagnosis_text, headline

T = np.arange(3000) / 100
U = 5 - 5 * np.cos(T * (1 + T / 40))


def plays(values):
    """Six plays of growing width."""
    return np.mean([play(values, width, 0.0) for width in np.linspace(0.2, 2.0, 6)], axis=0)


STAGES = {"line": 0.3 * U + 1.0, "curve": 0.3 * U + 0.4 * np.tanh(U - 4), "loop": 0.3 * plays(U)}


@pytest.fixture(scope="module")
def found():
    rng = np.random.default_rng(4)
    return {
        name: pj.diagnose(
            pj.Record.from_arrays(T, U, z + 2e-3 * rng.normal(size=len(z))), ["drift"], levels=9
        )
        for name, z in STAGES.items()
    }


def test_their_errors_are_those_of_least_squares(found):
    fit = found["curve"].base
    line, curve = found["curve"].memoryless
    rows, held_out = fit.identification, fit.validation
    slope, offset = np.polyfit(U[rows], fit.record.output[rows], 1)
    missed = fit.record.output - slope * U - offset
    assert line.rms_validation == pytest.approx(np.sqrt(np.mean(missed[held_out] ** 2)))
    assert line.rms_identification == pytest.approx(np.sqrt(np.mean(missed[rows] ** 2)))
    plane = fit.model.plane
    knots = [plane.low, *plane.thresholds, plane.high]
    place = np.interp(U, knots, [0, *(np.arange(plane.levels) + 0.5), plane.levels])
    ramps = [np.interp(place, [k, k + 1], [0, 1]) for k in range(plane.levels)]
    columns = np.stack([np.ones(len(U)), *ramps], axis=1)
    values = np.linalg.lstsq(columns[rows], fit.record.output[rows], rcond=None)[0]
    missed = fit.record.output - columns @ values
    assert curve.rms_validation == pytest.approx(np.sqrt(np.mean(missed[held_out] ** 2)))
    assert curve.max_abs_validation == pytest.approx(np.abs(missed[held_out]).max())


def test_no_hysteresis_is_a_sentence_of_its_own(found):
    sentences = {name: one.sentence for name, one in found.items()}
    assert re.match(r"No hysteresis: a straight line \([\d.]+ \+ 0.3 times", sentences["line"])
    assert "No hysteresis: a single-valued curve does as well" in sentences["curve"]
    assert "hysteresis: a" not in sentences["loop"]
    assert [one.does_as_well for one in found["curve"].memoryless] == [False, True]
    assert all(one.verdict == "adequate" for one in found.values())


def test_little_hysteresis_is_said_to_be_little(found):
    rng = np.random.default_rng(5)
    z = STAGES["line"] + 2e-3 * plays(U) + 2e-5 * rng.normal(size=len(U))
    fit = pj.fit(pj.Record.from_arrays(T, U, z), levels=9)
    line, _ = memoryless(fit)
    assert (line.does_as_well, line.does_nearly) == (False, True)
    assert memoryless(found["loop"].base, tolerance=1.0)[0].does_nearly


def test_all_rungs_stand_in_every_table_and_figure(found):
    one = found["loop"]
    rows = json.loads(json.dumps(one.to_json()))["memoryless"]
    assert [row["name"] for row in rows] == ["straight line", "single-valued curve"]
    errors = [rung.rms_validation for rung in one.rungs]
    assert min(errors[:2]) > 10 * errors[2]
    text = diagnosis_text(one)
    assert text.index("straight line:") < text.index("curve:") < text.index("Preisach model:")
    ticks = [tick.get_text() for tick in waterfall(one).axes[0].get_xticklabels()]
    assert ticks == ["straight\nline", "single-valued\ncurve", "Preisach\nmodel"]


def test_several_records_have_a_constant_each():
    parts = [pj.Record.from_arrays(T, U, 0.3 * U + shift) for shift in (0.0, 5.0)]
    fit = pj.fit(parts, levels=5)
    assert memoryless(fit)[0].rms_validation < 1e-9


@pytest.mark.parametrize(("noise", "limited"), [(1e-3, True), (0.02, False)])
def test_a_plane_that_is_the_limit_is_said_to_be(found, noise, limited):
    one = found["loop"]
    budget = replace(one.budget, noise=noise, discretisation=0.03, unexplained=0.0)
    said = sentence("adequate", (), budget, one.steps)
    assert ("No effect can be seen" in said and "the plane is the limit" in said) == limited
    assert ("Nothing is missing" in said) != limited
    told = replace(one, budget=budget)
    assert ("the cells of the plane are the limit" in headline(told)) == limited


def test_a_loop_that_no_held_out_row_passes_is_seen():
    """A period of 24 blocks: those held out lie where the branches meet."""
    t = np.arange(3000) / 100
    field = 10 * np.sin(2 * np.pi * t / 7.5)
    up = np.diff(field, append=field[-1]) > 0
    steps = np.tanh((field - np.where(up, 0.3, -0.3)) / 0.2)
    rng = np.random.default_rng(6)
    fit = pj.fit(pj.Record.from_arrays(t, field, steps + 6e-3 * rng.normal(size=3000)), levels=9)
    assert not any(one.does_as_well for one in memoryless(fit))


def test_a_line_without_noise_has_its_slope_and_offset_told():
    found = pj.diagnose(pj.Record.from_arrays(T, U, 0.2 * U + 3.0), ["drift"], levels=9)
    line = found.memoryless[0]
    assert (line.offset, line.slope) == pytest.approx((3.0, 0.2))
    assert found.sentence.startswith("No hysteresis: a straight line (3 + 0.2 times the input)")
    assert headline(found) == "There is no hysteresis to be seen"
