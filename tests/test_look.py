"""The first look at a record: what is planted in it is found, and what it cannot tell is said."""

import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.effects import library
from preisach_jax.look import look
from preisach_jax.look.drawing import braille_curve
from preisach_jax.look.prospects import judged_effects
from preisach_jax.look.stretches import band_decades, noise_rms, period, repeating_period, rests

STEP = 0.001
UNITS = {"input": "V", "output": "um"}


def path(*parts):
    """Ramps `(to, seconds)` from 0 on, and rests where the level stays."""
    levels = [0.0]
    for level, seconds in parts:
        count = round(seconds / STEP)
        levels += np.linspace(levels[-1], level, count + 1)[1:].tolist()
    return np.array(levels)


def record_of(u, noise=0.0, **changes):
    t = STEP * np.arange(len(u))
    z = u**1.1 + noise * np.random.default_rng(0).normal(size=len(u))
    arrays = {"time": t, "input": u, "output": z} | changes
    return pj.Record.from_arrays(**arrays, units=UNITS, name="stage.csv")


LOOPS = path(*[(10, 0.5), (0, 0.5)] * 5)
HOLDS = path(
    (4, 0.1), (4, 0.05), (8, 0.1), (8, 0.5), (10, 0.1), (10, 2), (6, 0.1), (6, 0.05), (3, 0.1),
    (3, 0.5), (0, 0.1), (0, 2),
)  # fmt: skip
RATES = path(*[(10, 2), (0, 2)], *[(10, 0.2), (0, 0.2)] * 3, *[(10, 0.02), (0, 0.02)] * 3)
MINOR = path(
    (3, 0.3), (1, 0.2), (3, 0.2), (6, 0.3), (4, 0.2), (6, 0.2), (9, 0.3), (7, 0.2), (9, 0.2), (0, 1)
)


def test_planted_rests_are_found_where_they_are():
    found = look(record_of(HOLDS, 1e-3)).excitation.rests
    assert [round(rest.level) for rest in found] == [4, 8, 10, 6, 3, 0]
    np.testing.assert_allclose(
        [rest.length_s for rest in found], [0.05, 0.5, 2, 0.05, 0.5, 2], atol=0.01
    )
    assert rests(record_of(path((1, 5.0), (10, 0.1), (0, 0.1)))) == []  # a slow ramp is none


def test_turns_and_rates_are_those_that_were_played():
    excitation = look(record_of(RATES)).excitation
    assert len(excitation.turns) == 13
    slowest, fastest = excitation.rates
    assert slowest == pytest.approx(5.0, rel=0.1)
    assert fastest == pytest.approx(500.0, rel=0.1)
    assert excitation.decades == pytest.approx(2.0, abs=0.1)
    assert look(record_of(LOOPS)).excitation.repeats == 5


@given(st.floats(1e-4, 1e-1), st.integers(0, 99))
def test_noise_is_measured_on_a_smooth_course(sigma, seed):
    course = 5 * np.sin(np.arange(4000) / 500)
    values = course + sigma * np.random.default_rng(seed).normal(size=4000)
    assert noise_rms(values) == pytest.approx(sigma, rel=0.1)


def test_planted_spikes_stuck_and_clipped_stretches_are_found():
    u = LOOPS.copy()
    z = u**1.1
    z[[700, 2300]] += [5.0, -5.0]
    z[3100:3200] = z[3100]
    top = 0.9 * z[np.arange(len(z)) < 700].max()
    found = look(record_of(u, output=np.minimum(z, top)))
    assert {700, 2300} >= set(found.output_spikes.tolist()) >= {2300}
    assert any(abs(each.begin_s - 3.1) < 0.01 for each in found.stuck)
    assert len(found.clipped) == 5
    assert all(each.level == pytest.approx(top) for each in found.clipped)
    shown = dict(found.rows())
    assert re.fullmatch(r"for .* from 3.1 s on at .*", shown["output sticks"])
    assert shown["output clipped"].endswith("the longest of 5 stretches")


def test_the_peaks_of_a_fast_course_are_no_spikes():
    # A force that swings over within some samples while the input hardly moves, as dampers do.
    t = np.arange(4000) / 1000
    u = np.sin(2 * np.pi * t)
    burst = sum(np.exp(-(((t - at) / 0.002) ** 2)) for at in (0.25, 0.75, 1.25, 2.75))
    z = 10 * u + burst
    z[2000] += 3.0
    found = pj.look(pj.Record.from_arrays(t, u, z))
    assert found.output_spikes.tolist() == [2000]


@pytest.mark.parametrize(
    ("u", "well", "not_at_all"),
    [
        (LOOPS, {"drift", "ageing", "hum"}, {"creep", "delay", "moving"}),
        (HOLDS, {"creep"}, {"ageing", "moving"}),
        (RATES, {"rate_dependence", "delay", "input_lag"}, set()),
        (MINOR, {"moving"}, {"creep", "ageing"}),
    ],
)
def test_what_a_record_can_tell_follows_from_what_it_holds(u, well, not_at_all):
    found = look(record_of(u))
    assert well <= set(found.can_tell)
    assert not_at_all <= set(found.cannot_tell)
    for each in found.prospects:
        assert each.grade == "well" or each.remedy or each.effect == "output_nonlinearity"
    # A sound record has no blemish.
    assert not [*found.output_spikes, *found.input_spikes, *found.stuck, *found.clipped]


def test_every_effect_of_the_library_is_judged():
    own = {name for name in library() if not name.endswith(":COL")}
    assert set(judged_effects()) >= own, "add a rule to _RULES of look/prospects.py"


def test_a_period_is_found_and_noise_has_none():
    noise = np.random.default_rng(0).normal(size=1000)
    assert period(np.tile(noise, 3)) == 1000
    assert period(noise) is None
    moved, still = np.linspace(0.0, 1.0, 100), np.ones(2000)
    assert repeating_period(np.concatenate([moved, still])) is None
    assert band_decades(noise) > 1.5
    assert band_decades(np.sin(2 * np.pi * np.arange(1000) / 50)) < 0.1


def test_the_command_shows_columns_reasons_and_a_picture_the_json_the_same_and_the_figure_is_drawn(
    tmp_path, capsys
):
    u = np.concatenate([LOOPS, HOLDS])
    table, stage = np.column_stack([STEP * np.arange(len(u)), u, u**1.1]), tmp_path / "stage.csv"
    np.savetxt(stage, table, header="t_s,u_V,z_um", delimiter=",", comments="")
    assert main(["look", str(stage)]) == 0
    out = capsys.readouterr().out
    for words in ("u_V", "by its name", "reversals", "rests", "shows well", "to record next"):
        assert words in out
    assert any(0x2800 < ord(sign) < 0x2900 for sign in out)
    figure = tmp_path / "look.png"
    assert main(["look", str(stage), "--json", "--plot", str(figure)]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["channels"]["input"] == {"column": "u_V", "unit": "V"}
    assert content["input"]["reversals"] == 11
    assert len(content["input"]["holds"]) == 6
    assert [each["role"] for each in content["columns"]] == ["time", "input", "output"]
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert main(["look", str(stage), "-q"]) == 0
    assert capsys.readouterr().out.startswith("shows well:")


def test_auxiliary_columns_are_looked_at(tmp_path, capsys):
    file = tmp_path / "loaded.csv"
    noise = np.random.default_rng(0).normal(size=(len(LOOPS), 2))
    table = np.column_stack([STEP * np.arange(len(LOOPS)), LOOPS, LOOPS**1.1, noise])
    np.savetxt(file, table, header="t_s,u_V,z_um,load_N,temp_C", delimiter=",", comments="")
    assert main(["look", str(file), "--aux", "load_N", "--aux", "5", "--json"]) == 0
    columns = json.loads(capsys.readouterr().out)["columns"]
    assert [each["role"] for each in columns[:3]] == ["time", "input", "output"]
    named = {each["name"]: each["why"] for each in columns if each["role"] == "aux"}
    assert named == dict.fromkeys(["load_N", "temp_C"], "you named it")


def test_a_curve_in_signs_lies_where_its_points_do():
    circle = np.linspace(0, 2 * np.pi, 400)
    rows = [row.ljust(10, "\u2800") for row in braille_curve(np.cos(circle), np.sin(circle), 10, 5)]
    lit = {(x, y) for y, row in enumerate(rows) for x, sign in enumerate(row) if sign != "\u2800"}
    assert {(0, 2), (9, 2), (5, 0), (5, 4)} <= lit
    assert not lit & {(0, 0), (9, 0), (0, 4), (9, 4), (5, 2)}
    up = braille_curve(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 2, 1)
    assert up == ["\u2860\u280a"]
