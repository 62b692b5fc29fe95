"""Thresholds where the output moves: chosen where they pay, and known wherever a model goes."""

import json

import numpy as np
import pytest
from exported import HIGH, LOW, Compiled, drawn, needs_compiler, predicted, smooth, wild

import preisach_jax as pj
from preisach_jax import InputError, Plane
from preisach_jax.export.description import describe
from preisach_jax.export.stepper import sample_by_sample
from preisach_jax.plot.axes import plane_edges, shown_density

THRESHOLDS = LOW + (HIGH - LOW) * np.array([0.05, 0.3, 0.42, 0.47, 0.5, 0.52, 0.57, 0.7, 0.95])
CHAINS = [[], ["creep", "moving"], ["rate_corners"], ["rate_smooth_all", "input_lag"]]


def magnet(samples=3000):
    """A field of ±10, and narrow relays near ±0.3 that it switches, one by one in NumPy."""
    rng = np.random.default_rng(1)
    up, width = rng.normal(0.3, 0.05, 400), np.abs(rng.normal(0.6, 0.1, 400))
    t = np.arange(samples) / 100
    field = 10.0 * np.exp(-t / 12) * np.sin(2 * np.pi * 0.35 * t**1.1)
    states, output = np.zeros(400), np.empty(samples)
    for k, x in enumerate(field):
        states = np.where(x >= up, 1.0, np.where(x <= up - width, 0.0, states))
        output[k] = states.mean() + 0.05 * np.tanh(x / 5)
    return pj.Record.from_arrays(t, field, output + 1e-4 * rng.normal(size=samples))


@pytest.fixture(scope="module")
def steep():
    record = magnet()
    return record, pj.fit(record)


def test_a_narrow_steep_loop_gets_thresholds_where_it_moves(steep):
    record, fit = steep
    plane = fit.model.plane
    inside = np.abs(plane.thresholds) < 1.0
    assert inside.sum() > 0.7 * plane.levels
    assert (plane.low, plane.high) == (record.input.min(), record.input.max())
    even = np.abs(Plane(plane.levels, plane.low, plane.high).thresholds) < 1.0
    assert even.sum() < 0.2 * plane.levels
    assert fit.rms_validation < 0.012 * np.ptp(record.output)


def test_a_smooth_loop_keeps_equal_cells():
    t = np.arange(2000) / 100
    u = 5 - 5 * np.cos(t * (1 + t / 40))
    assert pj.fit(pj.Record.from_arrays(t, u, u**1.2), levels=9).model.plane.own_thresholds is None


def course():
    return np.concatenate([wild(300, 2), smooth(100, 3)])


@needs_compiler
@pytest.mark.parametrize("names", CHAINS, ids="+".join)
def test_its_code_is_the_model(names, tmp_path):
    u, first = course(), int("rate_corners" in names)
    for hysteron in ("ramp", "relay") if names == [] else ("ramp",):
        model = drawn(names, hysteron=hysteron, thresholds=THRESHOLDS)
        compiled = Compiled(model, tmp_path)
        # The widening of a smooth input looks ahead in `predict`, and cannot in the code.
        ahead = "rate_smooth_all" in names
        expected = sample_by_sample(describe(model), u[:, None]) if ahead else predicted(model, u)
        np.testing.assert_allclose(compiled(u)[first:], expected[first:], rtol=0, atol=1e-11)
    if names in CHAINS[:2]:
        wanted = compiled.again(smooth(300, 6, LOW + 1, HIGH - 1))
        drive = compiled.inverse(wanted)
        np.testing.assert_allclose(compiled.again(drive), wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("names", CHAINS[1:3], ids="+".join)
def test_a_drive_for_a_wanted_output_is_found(names):
    model = drawn(names, thresholds=THRESHOLDS)
    u = smooth(400, 6, LOW + 1, HIGH - 1)
    time = (2048 + np.arange(len(u))) / 512
    wanted = model.predict(pj.Record.from_arrays(time, u, np.nan * u)).output
    found = pj.compensate(model, pj.Record.from_arrays(time, 0 * u, wanted))
    assert np.abs(found.expected - wanted)[found.reachable].max() < 0.02
    assert found.reachable.mean() > 0.9


def test_its_file_holds_the_thresholds(steep, tmp_path):
    record, fit = steep
    path = tmp_path / "model.json"
    fit.model.save(path)
    again = pj.Model.load(path)
    assert again.plane == fit.model.plane
    np.testing.assert_array_equal(again.predict(record).output, fit.model.predict(record).output)
    content = json.loads(path.read_text())
    content["thresholds"][3] = content["thresholds"][2]
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"thresholds\[3\] is .*: give ascending thresholds"):
        pj.Model.load(path)


def test_a_density_is_the_weight_over_the_area_of_its_cell(steep):
    model = steep[1].model
    edges, _ = plane_edges(model)
    widths = np.diff(edges)
    areas = widths[model.plane.alpha_index] * widths[model.plane.beta_index]
    np.testing.assert_allclose(shown_density(model) * areas, model.weights)
    assert edges[[0, -1]] == pytest.approx([model.plane.low, model.plane.high])
