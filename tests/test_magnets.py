"""Magnets: what cycles lose, excess loss, and records in either direction."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from oracles import play

import preisach_jax as pj
from preisach_jax.diagnosis.selection import effects_to_try
from preisach_jax.errors import InputError
from preisach_jax.loss import closed_cycles
from preisach_jax.plant.magnets import (
    BURSTS,
    PEAK_T,
    draw_losses,
    make_core,
    simulate_magnet,
    sine_bursts,
)
from preisach_jax.present import loss_table
from preisach_jax.record.joined import as_one
from preisach_jax.report import write_report

MU_0 = 4e-7 * math.pi
TIME = np.arange(4000) / 1000


def record_of(made, driven="B"):
    """The record of a core, with the induction or the field as its input."""
    field, induction = (made.field, "A/m"), (made.induction, "T")
    (x, unit_x), (y, unit_y) = (induction, field) if driven == "B" else (field, induction)
    units = {"input": unit_x, "output": unit_y} | ({"temp_C": "°C"} if made.aux else {})
    return pj.Record.from_arrays(made.time, x, y, aux=made.aux, units=units)


def pair(h, b, unit_h, unit_b, swapped=False, name_h="H"):
    """A record of a field and an induction whose columns have names."""
    (x, unit_x), (y, unit_y) = [(h, unit_h), (b, unit_b)][:: -1 if swapped else 1]
    record = pj.Record.from_arrays(TIME, x, y, units={"input": unit_x, "output": unit_y})
    role = "output" if swapped else "input"
    named = replace(record.channels[role], name=name_h)
    return replace(record, channels={**record.channels, role: named})


# --- against closed forms ---


@pytest.mark.parametrize(
    ("unit_h", "per_h", "unit_b", "per_b", "swapped"),
    [
        ("kA/m", 1e3, "mT", 1e-3, False),
        ("Oe", 1000 / (4 * math.pi), "G", 1e-4, True),
        ("mT", 1e-3 / MU_0, "T", 1.0, True),
        ("G", 1e-4 / MU_0, "kG", 0.1, False),
    ],
)
def test_an_ellipse_loses_its_area_in_any_units(unit_h, per_h, unit_b, per_b, swapped):
    h, b = 80 * np.cos(6.1 * TIME), 1.2 * np.cos(6.1 * TIME - 0.2)
    loss = pj.loss_per_cycle(pair(h / per_h, b / per_b, unit_h, unit_b, swapped, "mu0H"))
    assert (loss.unit, loss.field) == ("J/m3", "output" if swapped else "input")
    exact = math.pi * 80 * 1.2 * math.sin(0.2)
    got = [cycle.measured for cycle in loss.cycles]
    assert len(got) == 3
    np.testing.assert_allclose(got, exact, rtol=1e-4)
    assert all(math.isnan(cycle.model) for cycle in loss.cycles)


def test_other_units_have_the_unit_of_the_area():
    x, y = np.cos(6.1 * TIME), 2 * np.cos(6.1 * TIME - 0.5)
    loss = pj.loss_per_cycle(
        pj.Record.from_arrays(TIME, x, y, units={"input": "N", "output": "um"})
    )
    assert (loss.unit, loss.field) == ("N·µm", "")
    np.testing.assert_allclose(loss.cycles[0].measured, 2 * math.pi * math.sin(0.5), rtol=1e-4)
    # of which of two inductions is the field, only a name can tell
    assert pj.loss_per_cycle(pair(x, y, "T", "T", name_h="coil")).field == ""
    with pytest.raises(InputError, match=r"units are input 'N', output ''.*give them"):
        pj.loss_per_cycle(pj.Record.from_arrays(TIME, x, y, units={"input": "N"}))


def measured(seed, effects, f):
    """Loss of a cycle in steady state of a sinusoidal induction without noise; and the core."""
    b = 1.2 * np.sin(2 * np.pi * f * TIME)
    made = simulate_magnet(
        seed, effects=effects, drive=b, rate_hz=1000, noise_field=0, noise_induction=0
    )
    return pj.loss_per_cycle(record_of(made)).cycles[1].measured, made.core


def test_a_core_loses_its_closed_form_and_what_its_effects_say():
    static, core = measured(5, (), 20)
    assert static == pytest.approx(core.loss(1.2), rel=6e-3)
    law = draw_losses("eddy_currents", 5)
    conductivity, thickness = law["conductivity_S_per_m"], law["thickness_m"]
    classical = math.pi**2 * conductivity * thickness**2 * 1.2**2 * 20 / 6
    loss, _ = measured(5, ("eddy_currents",), 20)
    assert loss == pytest.approx(core.loss(1.2) + classical, rel=6e-3)
    assert classical > 0.1 * loss
    # Excess loss, over a period of c |B'|^(3/2)
    rate = 1.2 * 2 * np.pi * 5 * np.abs(np.cos(np.linspace(0, 2 * np.pi, 200_001)))
    expected = draw_losses("excess_loss", 6)["coefficient"] * np.mean(rate**1.5) / 5
    apart = measured(6, ("excess_loss",), 5)[0] - measured(6, (), 5)[0]
    assert apart == pytest.approx(expected, rel=5e-3)


def test_cycles_inside_others_lose_what_their_plays_do():
    """A play of half a width r is a parallelogram of 2 r by s - 2 r in a cycle of a swing s."""
    corners, radii = [0.0, 10.0, 2.0, 7.0, 4.0, 10.0, 3.0, 12.0, 0.0], np.arange(1, 24) / 4
    u = np.interp(np.arange(3201) / 400, np.arange(9), corners)
    z = sum(play(u, radius) for radius in radii)
    record = pj.Record.from_arrays(
        np.arange(len(u)) / 100, u, z, units={"input": "A/m", "output": "T"}
    )
    cycles = pj.loss_per_cycle(record).cycles
    swings = [cycle.input_high - cycle.input_low for cycle in cycles]
    np.testing.assert_allclose(swings, [3.0, 8.0, 7.0], atol=1e-9)
    expected = [np.sum(2 * radii * np.maximum(swing - 2 * radii, 0.0)) for swing in swings]
    np.testing.assert_allclose([cycle.measured for cycle in cycles], expected, rtol=1e-4)


# --- which cycles there are ---


def test_what_does_not_close_is_no_cycle():
    decaying = np.cos(6.1 * TIME) * np.exp(-TIME / 3)
    assert not closed_cycles(pj.Record.from_arrays(TIME, decaying, decaying))
    quick = np.cos(2 * np.pi * 100 * TIME)  # ten samples a cycle are too few
    assert not closed_cycles(pj.Record.from_arrays(TIME, quick, quick))


def test_cycles_stay_within_a_run_and_outputs_that_are_missing_are_bridged():
    h, b = 80 * np.cos(6.1 * TIME), 1.2 * np.cos(6.1 * TIME - 0.2)
    b[500:520] = np.nan
    b[1600:2400] = np.nan
    record = pair(h, b, "A/m", "T")
    first, second, third = pj.loss_per_cycle(record).cycles
    assert first.measured == pytest.approx(third.measured, rel=1e-3)
    assert math.isnan(second.measured)
    assert math.isnan(second.output_low)
    joined = as_one([record, pair(1.1 * h, b, "A/m", "T")], (), "fit")
    assert len(pj.loss_per_cycle(joined).cycles) == 6


# --- by a model ---


@pytest.fixture(scope="module", params=["B", "H"])
def fitted(request):
    made = simulate_magnet(1, seconds=6.0, rate_hz=500.0)
    levels = 25 if request.param == "B" else 13
    return request.param, made, pj.fit(record_of(made, request.param), levels=levels)


def test_a_core_is_fitted_in_both_directions(fitted):
    driven, made, fit = fitted
    assert fit.fit_percent > (99.0 if driven == "B" else 98.0)
    for cycle in fit.loss.cycles:
        assert cycle.low <= cycle.measured <= cycle.high
        assert abs(cycle.difference_percent) < 3
    assert "loss per cycle" in fit.summary()
    # Without a band, errors are of one sign along a branch.
    plain = replace(fit.model, band=None, rms_validation=0.5 / 1.96)
    cycle = pj.loss_per_cycle(fit.record, plain).cycles[0]
    length = 2 * (cycle.input_high - cycle.input_low)
    assert cycle.high - cycle.model == pytest.approx(0.5 * length, rel=0.05)
    assert made.core.loss(PEAK_T) < cycle.high


def test_the_band_holds_the_losses_of_another_record(fitted):
    driven, _, fit = fitted
    amplitudes = np.array([1.1, 0.85, 0.55, 0.25]) / PEAK_T
    course = np.concatenate([a * sine_bursts(3.0, 500.0)[:1000] for a in amplitudes])
    cycles = pj.loss_per_cycle(record_of(simulate_magnet(1, drive=course), driven), fit.model)
    inside = [cycle.low <= cycle.measured <= cycle.high for cycle in cycles.cycles]
    assert len(inside) > 10
    assert np.mean(inside) >= 0.9


# --- excess loss ---


@pytest.mark.parametrize("hidden", [("excess_loss",), ()])
def test_excess_loss_is_found_where_it_is_hidden_and_not_named_where_it_is_not(hidden, tmp_path):
    made = simulate_magnet(2, seconds=6.0, rate_hz=500.0, effects=hidden)
    found = pj.diagnose(record_of(made), ["excess_loss", "output_lag"], levels=9)
    assert found.effects == hidden
    if not hidden:
        return
    estimate = found.model.parameters["excess_loss"]["c"]
    true = made.truth["parameters"]["excess_loss"]["coefficient"]
    assert estimate.low <= true <= estimate.high
    assert estimate.value == pytest.approx(true, rel=0.05)
    # The losses are in the file and in the report.
    write_report(found, tmp_path)
    saved = json.loads((tmp_path / "diagnosis.json").read_text())["loss"]
    assert (saved["unit"], saved["field"]) == ("J/m3", "output")
    assert saved["cycles"][0]["low"] < saved["cycles"][0]["model"] < saved["cycles"][0]["high"]
    page = (tmp_path / "report.html").read_text()
    headers, rows = loss_table(found.final.loss, found.final.record)
    for shown in ("Loss per cycle", headers[4], *rows[0]):
        assert shown in page
    assert "loss per cycle" in found.summary()
    assert "measured loss" in found._repr_html_()


def test_losses_of_magnets_are_tried_by_default():
    made = simulate_magnet(1)
    tried = {
        driven: {effect.name for effect in effects_to_try(record_of(made, driven), None)}
        for driven in "BH"
    }
    assert tried["B"] - tried["H"] == {"excess_loss"}
    assert "eddy_currents" in tried["H"] - tried["B"]
    piezo = pj.Record.from_arrays(made.time, made.field, made.induction)
    assert not {"excess_loss", "eddy_currents"} & {e.name for e in effects_to_try(piezo, None)}


# --- the simulated worlds ---


def test_a_core_is_saved_and_is_what_its_table_says(tmp_path):
    made = simulate_magnet(4, effects=("gain:temp_C",), noise_field=0.0, noise_induction=0.0)
    made.save(tmp_path / "core.csv")
    record = pj.Record.load(
        tmp_path / "core.csv", time="t_s", input="B_T", output="H_A_per_m", aux=["temp_C"]
    )
    assert (record.input_unit, record.output_unit) == ("T", "A/m")
    np.testing.assert_allclose(record.output, made.field, rtol=1e-9, atol=1e-6)
    factor = 1 + draw_losses("gain:temp_C", 4)["gain_per_C"] * (made.aux["temp_C"] - 20.0)
    np.testing.assert_allclose(made.field, factor * make_core(4).field(made.induction))
    assert sum(cycles for _, cycles in BURSTS) * 3 == 30
    with pytest.raises(InputError, match="'creep': choose from"):
        simulate_magnet(effects=("creep",))
