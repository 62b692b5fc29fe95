"""The paper's figures: their numbers by hand, by SciPy and by the modules' own, and their looks."""

import inspect
import itertools
import json
from functools import cache
from typing import Any

import jax
import matplotlib as mpl
import numpy as np
import pytest
import scipy.signal
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from scipy import stats

from preisach_jax import AdaptiveFilter, InputError, Plane, paper
from preisach_jax.files import json_bytes
from preisach_jax.paper.numbers import identification
from preisach_jax.piezo import NOTCH_DENOMINATOR, NOTCH_NUMERATOR, paper_stage, resonances
from preisach_jax.plot.paper import FIGURES, PRINT, figures

signal: Any = scipy.signal  # whose results are typed as one of many
SAMPLES = 3000
SHORT: Any = {"levels": (19, 13, 9), "seeds": 2, "samples": 10_000}
QUICK: dict[str, dict[str, Any]] = {
    "4": {"realisations": 2},
    "5": {"seconds": 1.0, "samples": SAMPLES},
    "6": {"levels": 9, "samples": SAMPLES, "records": 2},
    "7": {"levels": 9, "samples": SAMPLES, "seconds": 0.1},
    "8": SHORT,
    "9": SHORT,
    "10": {"levels": (5, 9, 13), "samples": SAMPLES, "every": 2},
    "11": {"levels": 5, "samples": SAMPLES, "passes": (1,)},
}


@cache
def data_of(number) -> Any:
    """The data of a figure, from short records."""
    return FIGURES[number].data(**QUICK.get(number, {}))


# --- numbers ---


def test_hysteron_by_hand():
    """Between the thresholds the relay keeps its state; on a threshold it has switched."""
    loops = paper.hysteron_loops(points=13)
    x = np.arange(13) / 2
    np.testing.assert_array_equal(loops.input, x)
    np.testing.assert_array_equal(loops.relay_up, np.where(x >= 4.5, 1, -1))
    np.testing.assert_array_equal(loops.relay_down, np.where(x > 1.5, 1, -1))
    np.testing.assert_allclose(loops.ramp_up, np.clip(2 * (x - 4.5), -1, 1))
    np.testing.assert_allclose(loops.ramp_down, np.clip(2 * (x - 1.5), -1, 1))


def test_bode_finds_the_stage_and_the_notch():
    found = data_of("4")
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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: paper.bode(realisations=1), "realisations is 1: give at least 2"),
        (lambda: paper.fit_hinge(np.arange(9.0), np.ones(9)), "9 points"),
        (lambda: paper.relays_and_ramps((9, 5, 13)), "at least three, ascending"),
    ],
)
def test_what_is_too_little_is_told(call, message):
    with pytest.raises(InputError, match=message):
        call()


@pytest.fixture(scope="module")
def short_run():
    """A short record with N = 9, and the filter run over it, not by the figures' own function."""
    run = identification(0, SAMPLES, 9)
    with jax.enable_x64(True):
        result = AdaptiveFilter(Plane(9, 0.0, 75.0)).run(run.input_v, run.stroke_um)
    return run, jax.tree.map(np.asarray, result)


def test_loops_lie_within_the_major_loop():
    found = data_of("5")
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


def test_hinge_recovers_a_made_up_knee():
    knee, slope, level = 8000.0, -4e-4, -1.0
    rng = np.random.default_rng(1)
    k = np.sort(rng.uniform(0, 5e4, 2000))
    y = level + slope * np.minimum(k - knee, 0.0) + rng.normal(0.0, 0.5, k.size)
    found = paper.fit_hinge(k, y)
    assert found.knee == pytest.approx(knee, rel=0.1)
    assert found.slope == pytest.approx(slope, rel=0.1)
    assert found.level == pytest.approx(level, abs=0.05)
    assert found.deviation == pytest.approx(0.5, rel=0.05)
    np.testing.assert_allclose(found(np.array([knee * 2, 5e4])), found.level)


def test_the_knee_interval_is_as_wide_as_the_knee_scatters():
    """Against the knees of many independent draws of the rows."""
    rng = np.random.default_rng(3)
    k = np.arange(100.0)
    truth = -0.05 * np.minimum(k - 40.0, 0.0)
    draws = 10**truth * np.exp(rng.normal(0.0, 0.8, (60, 8, 100)))
    knees = [paper.fit_hinge(k, np.log10(rows.mean(axis=0))).knee for rows in draws]
    intervals = np.array([paper.knee_interval(k, rows, draws=50) for rows in draws[:12]])
    assert np.mean(knees) == pytest.approx(40.0, abs=0.5)
    assert np.mean(np.diff(intervals)) == pytest.approx(3.92 * np.std(knees), rel=0.4)


def test_convergence_shows_the_errors_at_events(short_run):
    (run, result), convergence = short_run, data_of("6")
    events = np.flatnonzero(result.switched > 0)
    np.testing.assert_array_equal(convergence.sample, events)
    np.testing.assert_allclose(convergence.error_squared_um2, result.error[events] ** 2)
    runs = run, identification(1, SAMPLES, 9)
    late = [r.error_um[600:][r.is_event[600:]] ** 2 for r in runs]
    assert convergence.mean_squared_um2 == pytest.approx(np.mean(np.concatenate(late)))
    # Blocks, one by one.
    in_block = []
    for rows in np.split(np.arange(SAMPLES), 100):
        powers = [r.error_um[rows][r.is_event[rows]] ** 2 for r in runs]
        if all(power.size for power in powers):
            in_block.append(np.mean([power.mean() for power in powers]))
    np.testing.assert_allclose(convergence.block_power_um2, in_block)
    hinge = json.loads(json_bytes(convergence.to_json()))["hinge"]
    assert set(hinge) == {"knee", "slope", "level", "deviation"}
    assert 4.0 < convergence.increment_squared_um2 / (75 / 9) ** 2 < 2.7**2


def test_time_frame_is_moved_by_its_mean(short_run):
    _, result = short_run
    frame = data_of("7")
    rows = slice(2700, 2900)
    np.testing.assert_allclose(frame.model_um, result.output[rows] + frame.shift_um)
    assert np.mean(frame.measured_um - frame.model_um) == pytest.approx(0.0, abs=1e-9)
    assert frame.difference_um == pytest.approx(np.std(frame.measured_um - frame.model_um))
    # Between its levels the filter stands still.
    assert np.count_nonzero(np.diff(frame.model_um)) < 40


def test_the_exponents_of_figure_8():
    """About 1 over switching samples, a quarter less over all; the parts add up to it."""
    found = data_of("8")
    N, norm = found.levels, found.over_events_um
    assert found.events.value == pytest.approx(1.0, abs=0.12)
    assert found.samples.value == pytest.approx(0.75, abs=0.12)
    slope, height = np.polyfit(np.log(N**-2.0), np.log(norm), 1)  # W falls as N^-2
    assert found.events.value == pytest.approx(slope)
    np.testing.assert_allclose(
        found.line_events_um,
        np.exp(height) * (found.line_power_um2 / (found.noise_power_um2 * N**2).mean()) ** slope,
    )
    each = paper.noise_sweep(0, **SHORT).output_error / np.sqrt(N * (N + 1) / 2)[:, None]
    np.testing.assert_allclose(found.events_deviation_um, np.abs(np.diff(each)[:, 0]) / np.sqrt(2))
    squares = each**2
    low, high = stats.t.interval(0.95, 1, squares.mean(axis=1), stats.sem(squares, axis=1))
    np.testing.assert_allclose(found.band_events_um[1], np.sqrt(high))
    np.testing.assert_allclose(
        found.band_events_um[0], np.sqrt(np.maximum(low, 0.01 * squares.mean(axis=1)))
    )
    parts = found.root_cells_in_levels.value - found.error_in_levels.value
    assert found.events.value == pytest.approx(parts / 2, rel=1e-9)
    share = found.share_in_levels.value
    assert share == pytest.approx(1.0, abs=0.1)
    assert found.samples.value == pytest.approx(found.events.value - share / 4, abs=0.05)


def test_the_coefficients_of_figure_9():
    found = data_of("9")
    assert found.exponent.value == pytest.approx(1.0, abs=0.02)
    L, N = found.levels * (found.levels + 1) / 2, found.levels
    np.testing.assert_allclose(found.bound, 32 * N * L * (N * L + 2) ** 2 * (L * N**2 + 1))
    np.testing.assert_allclose(found.orders, [14.8, 12.9, 11.1], atol=1.0)
    # On the first input the average of what each noise adds; eight noises tell it this well.
    assert np.all(np.abs(found.exact - found.same_input) < 4 * found.same_input_error)
    np.testing.assert_allclose(found.coefficient, found.exact, rtol=0.2)
    noisiest, part = found.total_um2[:, -1], found.noise_part_um2[:, -1]
    np.testing.assert_allclose(noisiest, part, rtol=0.3)  # the rest of the initial error is small
    assert np.all(found.floor_um2 < 0.1 * noisiest)


def test_ramps_beat_relays():
    found = data_of("10")
    assert np.all(found.ramp_um < 0.3 * found.relay_um)
    assert found.relay.value == pytest.approx(-1.0, abs=0.25)
    slope = np.polyfit(np.log(found.levels), np.log(found.relay_error_um), 1)[0]
    assert found.relay.value == pytest.approx(slope)


def test_numbers_do_not_depend_on_the_precision_set_outside():
    found = []
    for double in (False, True):
        identification.cache_clear()
        with jax.enable_x64(double):
            found.append(identification(0, SAMPLES, 9).output_um)
    np.testing.assert_array_equal(*found)
    assert found[0].dtype == np.float64


# --- drawings ---


@pytest.mark.parametrize("number", FIGURES)
def test_no_two_texts_overlap(number, monkeypatch):
    drawn, draw = [], Text.draw

    def noted(text, renderer):
        drawn.append(text)
        draw(text, renderer)

    monkeypatch.setattr(Text, "draw", noted)
    figure = FIGURES[number].draw(data_of(number))
    canvas = FigureCanvasAgg(figure)
    with mpl.rc_context(PRINT):
        canvas.draw()
    every = [axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]
    minor = {tick.label1 for axis in every for tick in axis.get_minor_ticks()}
    texts = [one for one in dict.fromkeys(drawn) if one.get_visible() and one.get_text()]
    texts = [one for one in texts if one not in minor]
    assert len(texts) > 5
    boxes = [one.get_window_extent(canvas.get_renderer()).shrunk(0.9, 0.8) for one in texts]
    for (one, box), (other, its) in itertools.combinations(zip(texts, boxes, strict=True), 2):
        assert not box.overlaps(its), f"{one.get_text()!r} on {other.get_text()!r}"


def test_chosen_figures_are_written(tmp_path):
    for one in FIGURES.values():
        inspect.signature(one.data).bind(**one.quick)
    paths = figures(tmp_path / "out", ["2", "1"], quick=True)
    names = [path.name for path in paths]
    kinds = ("pdf", "png", "json")
    assert names == [f"figure_{n}_quick.{kind}" for n in ("02", "01") for kind in kinds]
    assert all(path.stat().st_size > 500 for path in paths)
    content = json.loads((tmp_path / "out" / "figure_01_quick.json").read_text())
    assert (content["figure"], content["title"]) == (1, FIGURES["1"].title)
    assert len(content["input"]) == len(content["relay_up"]) == 241


def test_unknown_figures_are_refused_before_the_work(tmp_path):
    with pytest.raises(InputError, match="there is no figure 12: choose from 1, 2, 3"):
        figures(tmp_path / "out", ["1", "12"])
    assert not (tmp_path / "out").exists()
