"""Model files read back to the last bit or are refused; predictions go on from what is known."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest
import scipy
import world
from threadpoolctl import threadpool_limits

import preisach_jax as pj
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.effects.ageing import Ageing
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.files import plain_json
from preisach_jax.fit.fitted import finished
from preisach_jax.fit.stepwise import plane_of
from preisach_jax.identify.problem import Problem, evaluate
from preisach_jax.model import FORMAT_VERSION, Model
from preisach_jax.model.band import Band, InputMotion, Others, drift_deviation, spread_of
from preisach_jax.operator.plane import Plane
from preisach_jax.record.core import Record
from preisach_jax.record.course import time_since_reversal

RATE = 500.0
UNITS = {"input": "V", "output": "um"}


def actuator(excitation=3, begin=0.0):
    """A world with nothing hidden: one operator along some excitation."""
    drive = world.excitation("rich", 6.0, RATE, excitation)
    noise = 0.02 * np.random.default_rng(excitation).normal(size=len(drive))
    output = world.make_world(3).hysteresis(drive) + noise
    return Record.from_arrays(
        begin + np.arange(len(drive)) / RATE, drive, output, units=UNITS, name="stage.csv"
    )


@pytest.fixture(scope="module")
def record():
    return actuator()


@pytest.fixture(scope="module")
def plain(record):
    return pj.fit(record, levels=9).model


@pytest.fixture(scope="module")
def rich(record):
    """A model with an effect of every place, on a record that has a load."""
    load = np.cumsum(np.random.default_rng(0).normal(size=len(record))) * 0.01
    loaded = Record.from_arrays(
        record.time, record.input, record.output + 0.3 * load, aux={"load_N": load}, units=UNITS
    )
    effects = tuple(
        effect.bound_to(Survey(record.duration_s, record.step_s))
        for effect in (InputLag(), Ageing(), Drift(), Auxiliary(column="load_N", unit="N"))
    )
    effects = (*effects, Creep(tau_s=(0.1, 1.0)))
    values = {
        "input_lag": {"tau_s": 0.01},
        "ageing": {"loss": 0.01, "tau_s": 3.0},
        "drift": {"tau_s": 2.0},
        "aux:load_N": {"tau_s": 0.02},
        "creep": {"c_1": 0.01, "c_2": 0.02},
    }
    with jax.enable_x64(True), threadpool_limits(1):
        problem = Problem.of(loaded)
        chain = Chain(plane_of(problem, 5), effects)
        return loaded, finished(problem, evaluate(problem, chain, values, 1e-4), loaded).model


def without_output(record, **changes):
    """The record as a prediction sees it."""
    arrays = {"time": record.time, "input": record.input, "aux": record.aux} | changes
    return Record.from_arrays(
        **arrays, output=np.full(len(arrays["input"]), np.nan), name="new.csv"
    )


# --- the file ---


def test_the_file_is_strict_json_that_says_what_it_is(tmp_path, plain, record):
    plain.with_budget(0.02, float("nan")).save(tmp_path / "model.json")

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    text = (tmp_path / "model.json").read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=refuse)
    assert content["format_version"] == FORMAT_VERSION
    assert (len(content["weights"]), content["levels"], content["noise"]) == (45, 9, 0.02)
    assert (content["low"], content["high"]) == (record.input.min(), record.input.max())
    assert content["units"] == {"time": "s", "input": "V", "output": "um"}
    assert content["identification"]["sha256"] == record.sha256


def test_an_interrupted_save_leaves_the_older_file(tmp_path, plain, monkeypatch):
    path = tmp_path / "model.json"
    plain.save(path)
    before = path.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(pj.InputError, match=r"model\.json: cannot be written \(No space"):
        plain.save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def refused(path):
    """The message with which a file is refused: one line that begins with its path."""
    with pytest.raises(pj.InputError) as caught:
        Model.load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert len(message) < 400
    return message


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (b"\xff\xfe\x00\x01" * 40, "not valid JSON"),
        (b'{"format": "preisach_jax model", "weights": [1.0, ', "not valid JSON"),
        (b"[1, 2, 3]", "no model of preisach_jax"),
        (b'{"verdict": "adequate"}', "no model of preisach_jax"),
        (b'{"format": "preisach_jax model"}', "format version None"),
    ],
)
def test_files_that_are_no_model_are_refused(tmp_path, text, says):
    path = tmp_path / "broken.json"
    path.write_bytes(text)
    assert says in refused(path)


def test_a_missing_file_is_named(tmp_path):
    assert "cannot be read" in refused(tmp_path / "nothing.json")
    assert "this is a folder" in refused(tmp_path)


@pytest.mark.parametrize(
    "found", [FORMAT_VERSION + 1, FORMAT_VERSION - 1, True, "3", 10**400], ids=lambda v: f"{v!r:.9}"
)
def test_other_versions_are_refused(tmp_path, plain, found):
    path, content = tmp_path / "new.json", plain_json(plain.to_json())
    path.write_text(json.dumps(content | {"format_version": found, "library_version": "9.9.9"}))
    message = refused(path)
    assert f"format version {found!r:.20} " in message
    assert f"reads version {FORMAT_VERSION}; install the version that wrote it" in message
    assert "9.9.9" in message


# --- predicting ---


def test_a_record_that_begins_with_it_goes_on(plain, record):
    more = world.excitation("rich", 0.8, RATE, 8)
    time = np.concatenate([record.time, record.time[-1] + (1 + np.arange(len(more))) / RATE])
    path = np.concatenate([record.input, more])
    whole = without_output(record, time=time, input=path)
    got = plain.predict(whole)
    np.testing.assert_allclose(got.output[: len(record)], plain.simulate(record), atol=1e-9)
    truth = world.make_world(3).hysteresis(path)
    after = (got.output - truth)[len(record) :]
    assert np.sqrt(np.mean(after**2)) < 2 * plain.rms_validation
    np.testing.assert_allclose(got.high - got.low, 2 * plain.half_width(whole))


def from_the_middle(seconds=6.0):
    """An input from 37 V that stays inside for a while and then covers the whole range."""
    time = np.arange(round(seconds * RATE)) / RATE
    corners = [37.0, 45.0, 30.0, 50.0, 25.0, 74.4, 0.05, 74.4, 40.0]
    path = np.interp(time, np.linspace(0, seconds, len(corners)), corners)
    return Record.from_arrays(1e4 + time, path, np.full(len(time), np.nan), name="new.csv")


def test_unknown_memory_widens_the_band_until_it_is_forced(plain):
    new = from_the_middle()
    got = plain.predict(new)
    half = (got.high - got.low) / 2 - plain.half_width(new)
    assert half[0] > 10 * plain.rms_validation
    assert np.all(np.diff(half) <= 1e-9)  # what has been forced stays known
    saturated = np.flatnonzero(new.input < 0.1)[0]
    np.testing.assert_allclose(half[saturated:], 0.0, atol=0.01)
    # The truth lies inside, whatever came before.
    for before in ([0.0, 37.0], [0.0, 75.0, 37.0], [0.0, 60.0, 20.0, 55.0, 37.0]):
        way = np.interp(np.linspace(0, len(before) - 1, 401), np.arange(len(before)), before)
        path = np.concatenate([way, new.input])
        truth = world.make_world(3).hysteresis(path)[-len(new) :]
        slack = 4 * plain.rms_validation
        assert np.all(truth > got.low - slack)
        assert np.all(truth < got.high + slack)


def test_stated_memory_is_used(plain):
    new = from_the_middle()
    free = plain.predict(new)
    told = Record.from_arrays(new.time, new.input, new.output, initial_memory="low")
    got = plain.predict(told)
    np.testing.assert_allclose(got.high - got.low, 2 * plain.half_width(told))
    expected = plain.offset + pj.simulate(plain.plane, plain.weights, new.input, initial="low")
    np.testing.assert_allclose(got.output, expected, atol=1e-6 * np.ptp(got.output))
    assert np.all((got.output >= free.low - 1e-6) & (got.output <= free.high + 1e-6))
    # Saturation is the edge of what unknown memory leaves open.
    edge = free.low + plain.half_width(new)
    np.testing.assert_allclose(got.output, edge, atol=1e-3 * np.ptp(new.input))


def test_the_band_covers_new_records_of_the_same_world(plain):
    """A world with nothing hidden, another excitation: 95 % in, or nearly so."""
    inside = []
    for excitation in (11, 12, 13):
        new = actuator(excitation=excitation, begin=1e4)
        got = plain.predict(without_output(new))
        inside.append((new.output >= got.low) & (new.output <= got.high))
    assert 0.9 < np.mean(inside) <= 0.99


def test_input_beyond_the_plane_is_refused(plain, record):
    path = np.array(record.input)
    path[[123, 700]] = [80.25, -9.0]
    told = r"new\.csv.* 80\.25 V in sample 124 .* 0 to 75 V .*2 such samples.*cut these"
    with pytest.raises(pj.InputError, match=told):
        plain.predict(without_output(record, input=path))


def test_no_prediction_that_is_not_finite_is_given(plain, record):
    told = r"sample 1: the model of stage.csv predicts .* \(-inf to inf\).*; fit the model again"
    with pytest.raises(pj.InputError, match=told):
        replace(plain, rms_validation=np.inf, band=None).predict(record)


def test_a_missing_auxiliary_column_is_named(rich):
    record, model = rich
    with pytest.raises(pj.InputError, match=r"new.csv.*'load_N'.*--aux load_N"):
        model.predict(without_output(record, aux={}))


def test_lags_and_creep_go_on_in_a_continuation(rich):
    """Of the history, the file keeps a thinned course: enough for what effects remember."""
    record, model = rich
    more = world.excitation("rich", 0.8, RATE, 8)
    time = record.time[-1] + (1 + np.arange(len(more))) / RATE
    load = np.full(len(more), record.aux["load_N"][-1])
    arrays = {"time": time, "input": more, "aux": {"load_N": load}}
    rest = without_output(record, **arrays)
    alone = model.predict(rest)
    whole = {
        "time": np.append(record.time, time),
        "input": np.append(record.input, more),
        "aux": {"load_N": np.append(record.aux["load_N"], load)},
    }
    expected = model.predict(without_output(record, **whole)).output[len(record) :]
    np.testing.assert_allclose(alone.output, expected, atol=2e-3 * np.ptp(expected))
    np.testing.assert_allclose(alone.high - alone.low, 2 * model.half_width(rest))
    # Without the clock, the memory is unknown.
    lost = model.predict(without_output(record, **arrays | {"time": time + 1000.0}))
    assert np.max(lost.high - lost.low - (alone.high - alone.low)) > 0.01 * np.ptp(expected)


def test_a_short_record_is_fitted():
    """The fewest samples that are taken; whatever is warned of is an error in these tests."""
    record = actuator()
    few = np.linspace(0, len(record) - 1, 50).astype(int)
    short = Record.from_arrays(record.time[few], record.input[few], record.output[few])
    found = pj.fit(short, levels=5)
    assert found.validation.sum() + found.identification.sum() == 50
    assert np.isfinite(found.prediction).all()
    assert found.fit_percent > 80


# --- the band by slices ---


def wandering(rows, rate_hz=500.0, seed=3):
    rng = np.random.default_rng(seed)
    time = np.arange(rows) / rate_hz
    corners = np.cumsum(rng.uniform(0.05, 0.5, 4 * round(time[-1]) + 8))
    path = np.interp(time, corners, rng.uniform(0, 9, len(corners)))
    return Record.from_arrays(time, path, path)


NO_OTHERS = Others(0, *np.zeros((4, 0, 1)))


def test_half_widths_are_conformal_quantiles_of_the_slices():
    """Against slices that are formed row by row, of residuals that no part of the law explains."""
    record = wandering(40000)
    course = InputMotion.of(record)
    rng = np.random.default_rng(3)
    residual = rng.normal(size=40000)
    residual[np.abs(course.speed - np.median(course.speed)) < 3] *= 3
    spread = np.zeros((40000, 2))
    band = Band.calibrated(course, residual, spread, 0.5, 0.0, NO_OTHERS)
    speed = np.abs(np.gradient(record.input, record.time))
    since = time_since_reversal(record.time, record.input)
    np.testing.assert_array_equal(course.since, since)
    deviation = band.law.deviation(course, spread)
    half = band.along(course, spread)
    for i in range(3):
        for j in range(3):
            inside = np.digitize(speed, band.speed, right=True) == i
            inside &= np.digitize(since, band.since, right=True) == j
            if inside.sum() < 3000:
                continue
            ordered = np.sort(np.abs(residual[inside]) / deviation[inside])
            expected = ordered[int(np.ceil(0.95 * (len(ordered) + 1))) - 1]
            np.testing.assert_allclose(half[inside], expected * deviation[inside])


def test_the_law_finds_what_the_variance_goes_with():
    """Residuals drawn with a known variance, and new ones of it held in each part alone."""
    record = wandering(20000)
    course = InputMotion.of(record)
    rng = np.random.default_rng(4)
    spread = np.abs(rng.normal(size=(20000, 2))) * [0.5, 2.0]
    usual = np.sqrt(np.mean(course.speed**2))
    true = 0.04 + 0.5 * (course.speed / usual) ** 2 + 1.5 * np.exp(-course.travel / 0.5)
    true += 3.0 * spread[:, 1] ** 2
    residual = rng.normal(size=20000) * np.sqrt(true)
    band = Band.calibrated(course, residual, spread, 0.5, 0.0, NO_OTHERS)
    found = band.law.deviation(course, spread) ** 2
    assert np.median(np.abs(np.log(found / true))) < 0.1
    half, fresh = band.along(course, spread), rng.normal(size=20000) * np.sqrt(true)
    for part in (course.speed, course.travel, spread[:, 1]):
        third = np.digitize(part, np.quantile(part, (1 / 3, 2 / 3)))
        for k in range(3):
            assert 0.93 < np.mean(np.abs(fresh[third == k]) <= half[third == k]) < 0.97


def test_no_band_is_narrower_than_the_noise():
    record = wandering(2000)
    course, none = InputMotion.of(record), np.zeros((2000, 2))
    band = Band.calibrated(course, np.zeros(2000), none, 1.0, 0.3, NO_OTHERS)
    np.testing.assert_allclose(band.along(course, none), 0.3 * scipy.stats.norm.ppf(0.975))


def test_the_spread_is_that_of_the_other_models(plain, record):
    """Against models that are built one by one."""
    found = spread_of(
        plain.chain,
        (plain.values, plain.coefficients),
        plain.band.others,
        record,
        lambda there, along: replace(plain, coefficients=there[1]).simulate(along),
    )
    here, others = plain.simulate(record), plain.band.others
    squares = np.zeros((len(record.time), 2))
    for k in range(len(others.offset)):
        coefficients = replace(
            plain.coefficients,
            weights=plain.weights + others.weights[k],
            offset=plain.offset + others.offset[k],
        )
        there = replace(plain, coefficients=coefficients).simulate(record)
        squares[:, 0 if k < others.of_blocks else 1] += (there - here) ** 2
    np.testing.assert_allclose(found, np.sqrt(squares), rtol=1e-9, atol=1e-12)
    assert (others.of_blocks, len(others.offset)) == (12, 28)


def test_a_wander_goes_on_as_it_went_and_another_record_has_another():
    """Against the increments of the course that is built from its cosines, lag by lag."""
    waves = Drift(horizon_s=10.0, waves=3)
    chain = Chain(Plane(4, 0.0, 1.0), (waves,))
    added = np.array([1.0, -0.5, 0.3])
    numbers = Coefficients(np.zeros(chain.plane.cells), np.zeros(chain.plane.cells), 0.0, added)
    lags = np.array([-3.0, 0.0, 1.0, 2.5, 5.0, 20.0])
    found = drift_deviation(chain, {"drift": {}}, numbers, (2.0, 12.0), 12.0 + lags, True)
    time = np.linspace(0, 10, 5001)
    course = np.cos(np.pi * time[:, None] / 10 * [1, 2, 3]) @ added
    expected = [np.sqrt(np.mean((course[k:] - course[:-k]) ** 2)) for k in (500, 1250, 2500)]
    np.testing.assert_array_equal(found[:2], 0)
    np.testing.assert_allclose(found[2:5], expected, rtol=0.01)
    np.testing.assert_allclose(found[5], 2 * found[4], rtol=0.01)  # variance grows with time
    found = drift_deviation(chain, {"drift": {}}, numbers, (2.0, 12.0), lags, False)
    np.testing.assert_allclose(found, np.sqrt(2) * course.std(), rtol=0.01)
    straight = Chain(chain.plane, (Drift(horizon_s=10.0),))
    numbers = replace(numbers, added=np.array([1.0]))
    values = {"drift": {"tau_s": 300.0}}
    assert not drift_deviation(straight, values, numbers, (2.0, 12.0), 12.0 + lags, True).any()


def test_a_band_comes_back_from_its_file(plain, record):
    content = json.loads(json.dumps(plain.to_json()))
    np.testing.assert_array_equal(
        Model.from_json(content).half_width(record), plain.half_width(record)
    )
    for inside, key, wrong, said in (
        (content["band"]["others"], "weights", ["1"], "others.weights is a list of 1: expected 28"),
        (content["band"]["others"], "weights", ["1 x"] * 28, r"others.weights\[0\] is '1 x'"),
        (content["band"], "half", [0.1] * 4, "band.half is a list of 4: expected 9"),
    ):
        right, inside[key] = inside[key], wrong
        with pytest.raises(pj.InputError, match=said):
            Model.from_json(content)
        inside[key] = right
    content["band"] = None  # of a model that was made without a fit
    np.testing.assert_array_equal(
        Model.from_json(content).half_width(record), 1.96 * plain.rms_validation
    )
