"""The numbers behind the paper's figures are right, by hand, by SciPy and by the modules' own."""

import json
from typing import Any

import jax
import numpy as np
import pytest
import scipy.signal

from preisach_jax import paper
from preisach_jax.errors import InputError
from preisach_jax.files import json_bytes
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.plane import Plane
from preisach_jax.paper.comparison import _held_out, _regressors
from preisach_jax.paper.experiment import identification
from preisach_jax.paper.noise import power_law_through
from preisach_jax.piezo import NOTCH_DENOMINATOR, NOTCH_NUMERATOR, paper_stage, resonances
from preisach_jax.sweep import realisation, sweep

signal: Any = scipy.signal  # whose results are typed as one of many
SHORT: Any = {"levels": (13, 9, 5), "seeds": 2, "samples": 4000}


def test_hysteron_by_hand():
    """Between the thresholds the relay keeps its state; on a threshold it has switched."""
    loops = paper.hysteron_loops(points=13)
    x = np.arange(13) / 2
    np.testing.assert_array_equal(loops.input, x)
    np.testing.assert_array_equal(loops.relay_up, np.where(x >= 4.5, 1, -1))
    np.testing.assert_array_equal(loops.relay_down, np.where(x > 1.5, 1, -1))
    np.testing.assert_allclose(loops.ramp_up, np.clip(2 * (x - 4.5), -1, 1))
    np.testing.assert_allclose(loops.ramp_down, np.clip(2 * (x - 1.5), -1, 1))


@pytest.mark.parametrize("diagram", [paper.filter_diagram, paper.experiment_diagram])
def test_diagrams_are_connected(diagram):
    """Every signal runs between blocks that are there, and no block is left out."""
    found = diagram()
    names = {block.name for block in found.blocks}
    ends = {end for signal in found.signals for end in (signal.source, signal.target)}
    assert ends - {""} == names
    assert len({(s.source, s.target) for s in found.signals}) == len(found.signals)


def test_every_equation_of_the_filter_is_in_its_diagram():
    text = " ".join(block.equation for block in paper.filter_diagram().blocks)
    assert all(f"({n})" in text for n in (5, 6, 7, 8, 10, 11, 12, 13))


def test_bode_finds_the_stage_and_the_notch():
    found = paper.bode(realisations=3)
    modes = resonances(NOTCH_NUMERATOR)
    np.testing.assert_allclose(found.mode_hz, modes.frequency_hz, atol=0.2)
    np.testing.assert_allclose(found.damping, modes.damping, rtol=0.05)
    assert np.all(found.mode_error_hz < 0.2)
    notch = signal.freqz(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, worN=found.grid_hz, fs=5000.0)[1]
    np.testing.assert_allclose(found.notch_db, 20 * np.log10(np.abs(notch)), atol=1e-9)
    np.testing.assert_allclose(
        np.cos(np.deg2rad(found.notch_deg) - np.angle(notch)), 1.0, atol=1e-12
    )
    # The model passes within the spread, apart from a line or two and the hysteresis' own scatter.
    at = np.interp(found.frequency_hz, found.grid_hz, found.model_db)
    away = np.abs(found.frequency_hz[:, None] / modes.frequency_hz - 1).min(axis=1) > 0.1
    assert np.sqrt(np.mean((at - found.measured_db)[away] ** 2)) < 0.3


def test_bode_needs_realisations_to_see_a_spread():
    with pytest.raises(InputError, match="realisations is 1: give at least 2"):
        paper.bode(realisations=1)


@pytest.fixture(scope="module")
def short_run():
    """A short record with N = 9, and the filter run over it, not by the figures' own function."""
    run = identification(0, 4000, 9)
    with jax.enable_x64(True):
        result = AdaptiveFilter(Plane(9, 0.0, 75.0)).run(run.input_v, run.stroke_um)
    return run, jax.tree.map(np.asarray, result)


def test_loops_lie_within_the_major_loop():
    found = paper.loops(seconds=1.0, samples=4000)
    branches = np.split(found.major_stroke_um[:-1], 2)
    drive = found.major_input_v[:300]
    rising = np.interp(found.input_v, drive, branches[0])
    with jax.enable_x64(True):
        down = np.linspace(75.0, 0.0, 301)
        path = np.asarray(paper_stage().hysteresis(np.concatenate([[0.0, 75.0], down])))[2:]
    falling = np.interp(found.input_v, down[::-1], path[::-1])
    # The resonances and the encoder add little.
    assert np.all(found.stroke_um > rising - 0.15)
    assert np.all(found.stroke_um < falling + 0.15)
    heading = np.sign(np.diff(found.input_v))
    assert found.turns == np.count_nonzero(np.diff(heading[heading != 0]))


def test_thinned_loops_keep_the_record():
    found = paper.loops(seconds=6.0, samples=12_000)
    run = identification(0, 12_000, 37)
    assert len(found.input_v) < 11_000
    assert set(found.stroke_um.tolist()) <= set(run.stroke_um.tolist())
    assert (found.input_v.min(), found.input_v.max()) == (run.input_v.min(), run.input_v.max())


@pytest.mark.parametrize(("knee", "slope", "level"), [(8000.0, -4e-4, -1.0), (20.0e3, -1e-4, 0.5)])
def test_hinge_recovers_a_made_up_knee(knee, slope, level):
    rng = np.random.default_rng(1)
    k = np.sort(rng.uniform(0, 5e4, 2000))
    y = level + slope * np.minimum(k - knee, 0.0) + rng.normal(0.0, 0.5, k.size)
    found = paper.fit_hinge(k, y)
    assert found.knee == pytest.approx(knee, rel=0.1)
    assert found.slope == pytest.approx(slope, rel=0.1)
    assert found.level == pytest.approx(level, abs=0.05)
    assert found.deviation == pytest.approx(0.5, rel=0.05)
    np.testing.assert_allclose(found(np.array([knee * 2, 5e4])), found.level)


def test_hinge_is_the_least_squares_fit():
    """No other line and level that meet is nearer to the points."""
    rng = np.random.default_rng(2)
    k = np.arange(60.0)
    y = -0.1 * np.minimum(k - 25.0, 0.0) + rng.normal(0.0, 0.3, 60)
    found = paper.fit_hinge(k, y)
    least = np.sum((y - found(k)) ** 2)
    for knee in np.linspace(2.0, 57.0, 40):
        design = np.stack([np.ones(60), np.minimum(k - knee, 0.0)], axis=1)
        squares = np.linalg.lstsq(design, y)[1][0]
        assert squares > least * (1 - 1e-3)
    assert found.deviation == pytest.approx(np.sqrt(least / 60))
    with pytest.raises(InputError, match="9 points"):
        paper.fit_hinge(k[:9], y[:9])


def test_knee_interval_covers():
    """Of intervals for 95 %, nearly all hold the true knee."""
    rng = np.random.default_rng(3)
    k = np.arange(100.0)
    truth = -0.05 * np.minimum(k - 40.0, 0.0)
    inside = 0
    for number in range(30):
        rows = 10**truth * np.exp(rng.normal(0.0, 0.8, (8, 100)))
        low, high = paper.knee_interval(k, rows, draws=100, seed=number)
        inside += low <= 40.0 <= high
    assert 23 <= inside <= 30


def test_convergence_shows_the_errors_at_events(short_run):
    run, result = short_run
    found = paper.convergence(levels=9, samples=4000, records=2)
    events = np.flatnonzero(result.switched > 0)
    np.testing.assert_array_equal(found.sample, events)
    np.testing.assert_allclose(found.error_squared_um2, result.error[events] ** 2)
    other = identification(1, 4000, 9)
    late = [r.error_um[800:][r.is_event[800:]] ** 2 for r in (run, other)]
    assert found.mean_squared_um2 == pytest.approx(np.mean(np.concatenate(late)))
    # Blocks, one by one.
    in_block = [
        [np.mean(r.error_um[40 * b : 40 * b + 40][r.is_event[40 * b : 40 * b + 40]] ** 2)
         for r in (run, other)]
        for b in range(100)
        if all(r.is_event[40 * b : 40 * b + 40].any() for r in (run, other))
    ]  # fmt: skip
    np.testing.assert_allclose(found.block_power_um2, np.mean(in_block, axis=1))
    assert 4.0 < found.increment_squared_um2 / (75 / 9) ** 2 < 2.7**2
    assert found.knee_low <= found.knee_high


def test_time_frame_is_moved_by_its_mean(short_run):
    _, result = short_run
    frame = paper.time_frame(levels=9, samples=4000, seconds=0.1)
    rows = slice(3600, 3800)
    np.testing.assert_allclose(frame.model_um, result.output[rows] + frame.shift_um)
    assert np.mean(frame.measured_um - frame.model_um) == pytest.approx(0.0, abs=1e-9)
    assert frame.difference_um == pytest.approx(np.std(frame.measured_um - frame.model_um))
    # Between its levels the filter stands still.
    assert np.count_nonzero(np.diff(frame.model_um)) < 40


@pytest.fixture(scope="module")
def short_sweep():
    return sweep(jax.random.key(0), levels=SHORT["levels"], seeds=2, samples=4000)


def test_proportionality_is_that_of_the_sweep(short_sweep):
    found = paper.proportionality(**SHORT)
    np.testing.assert_array_equal(found.over_events_um, short_sweep.auxiliary_norm())
    np.testing.assert_array_equal(found.over_samples_um, short_sweep.auxiliary_norm("samples"))
    np.testing.assert_array_equal(found.noise_power_um2, short_sweep.noise_power)
    slope, height = np.polyfit(np.log(found.noise_power_um2), np.log(found.over_events_um), 1)
    assert found.events.value == pytest.approx(slope)
    expected = np.exp(height + slope * np.log(found.line_power_um2))
    np.testing.assert_allclose(found.line_events_um, expected)
    # The exponents of the parts add up to that of the whole, since W falls as N^-2 exactly.
    parts = found.root_cells_in_levels.value - found.error_in_levels.value
    assert found.events.value == pytest.approx(parts / 2, rel=1e-9)
    short = found.events.value - found.share_in_levels.value / 4
    assert found.samples.value == pytest.approx(short, abs=0.05)


def test_coefficients_are_those_of_the_sweep(short_sweep):
    found = paper.coefficients(**SHORT)
    np.testing.assert_array_equal(found.coefficient, short_sweep.coefficient)
    np.testing.assert_array_equal(found.noise_part_um2, short_sweep.noise_part.mean(axis=2))
    np.testing.assert_array_equal(found.floor_um2, short_sweep.bias_squared.mean(axis=1))
    L = found.levels * (found.levels + 1) / 2
    N = found.levels
    np.testing.assert_allclose(found.bound, 32 * N * L * (N * L + 2) ** 2 * (L * N**2 + 1))
    for line, row in zip(found.lines_um2, found.noise_part_um2, strict=True):
        middle = power_law_through(
            found.noise_power_um2, row, found.exponent.value, found.line_power_um2
        )
        np.testing.assert_allclose(line, middle)


def test_exact_coefficient_is_that_of_many_noises():
    """On the first input, runs with one noise each average to the exact coefficient."""
    found = paper.coefficients(**SHORT)
    with jax.enable_x64(True):
        x = np.asarray(realisation(jax.random.key(0), 0, 4000, 8).record.input_v)
        plane = Plane(5, 0.0, 75.0)
        filt = AdaptiveFilter(plane, initial_weight=0.0)
        noise = np.random.default_rng(5).normal(size=(400, 4000))
        # Without a hysteresis the weights are the error; noise alone drives them.
        weights = jax.vmap(lambda n: _weights_over_time(filt, x, n))(noise)
    squares = np.sum(np.asarray(weights)[:, 800:] ** 2, axis=2).mean(axis=1)
    spread = squares.std(ddof=1) / np.sqrt(400)
    assert found.exact[2] == pytest.approx(squares.mean(), abs=4 * spread)


def _weights_over_time(filt, x, z):
    def advance(state, sample):
        state, _ = filt.step(state, *sample)
        return state, state.weights

    return jax.lax.scan(advance, filt.init(x[0], z[0]), (x, z))[1]


def test_relays_and_ramps_on_a_grid_of_their_own():
    """An output on the plane's own grid is predicted to the noise, whichever the hysteron."""
    plane = Plane(4, 0.0, 75.0)
    rng = np.random.default_rng(0)
    x = np.interp(
        np.arange(8000), np.arange(0, 8001, 80), rng.uniform(0, 75, 101) * (np.arange(101) > 0)
    )
    noise = rng.normal(0.0, 0.01, 8000)
    for hysteron in ("relay", "ramp"):
        with jax.enable_x64(True):
            states = _regressors(plane, hysteron, x, 1)
            clean = states @ np.append(np.linspace(1.0, 2.0, 10), 5.0)
            residual, error, _ = _held_out(plane, hysteron, x, clean, noise, 2, 1e-8)
        assert residual == pytest.approx(0.01, rel=0.05)
        assert error < 0.002


def test_chunks_of_states_are_one_run():
    from preisach_jax.operator.states import hysteron_states

    plane = Plane(3, 0.0, 75.0)
    x = 75 * np.abs(np.sin(np.arange(11_003) / 700))
    with jax.enable_x64(True):
        for hysteron in ("relay", "ramp"):
            whole = np.asarray(hysteron_states(plane, x, "low", hysteron))[::7]
            rows = _regressors(plane, hysteron, x, 7)
            np.testing.assert_array_equal(rows[:, :-1], whole)
            np.testing.assert_array_equal(rows[:, -1], 1.0)


def test_ramps_beat_relays():
    found = paper.relays_and_ramps((5, 9, 13), samples=6000, every=2)
    assert np.all(found.ramp_um < 0.3 * found.relay_um)
    assert found.relay.value == pytest.approx(-1.0, abs=0.25)
    slope = np.polyfit(np.log(found.levels), np.log(found.relay_error_um), 1)[0]
    assert found.relay.value == pytest.approx(slope)
    with pytest.raises(InputError, match="at least three, ascending"):
        paper.relays_and_ramps((9, 5, 13), samples=4000)


def test_numbers_are_ready_for_json():
    told = []
    found = paper.recursions(
        levels=4, samples=1500, passes=(1,), progress=lambda text, part: told.append(part)
    )
    content = json.loads(json_bytes(found.to_json()))
    assert content["caption"].startswith("Recursions over one record of 1500 samples")
    assert content["names"][0] == "adaptive filter, 1 pass"
    np.testing.assert_allclose(content["ramp_replay"], found.ramp_replay, rtol=1e-6)
    assert told == sorted(told)
    assert told[0] == 0.0
    hinge = json.loads(json_bytes(paper.convergence(9, samples=4000, records=2).to_json()))["hinge"]
    assert set(hinge) == {"knee", "slope", "level", "deviation"}


def test_numbers_do_not_depend_on_the_precision_set_outside():
    identification.cache_clear()
    single = paper.time_frame(levels=5, samples=2000)
    identification.cache_clear()
    with jax.enable_x64(True):
        double = paper.time_frame(levels=5, samples=2000)
    np.testing.assert_array_equal(single.model_um, double.model_um)
    assert single.model_um.dtype == np.float64
