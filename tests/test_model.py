"""Model files read back to the last bit or are refused; predictions go on from what is known."""

import json
from dataclasses import replace
from itertools import pairwise

import jax
import numpy as np
import pytest
import scipy
import world
from threadpoolctl import threadpool_limits

import preisach_jax as pj
from preisach_jax.chain import Chain, Coefficients
from preisach_jax.effects.ageing import Ageing
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import AddedEffect, Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.parameter import Parameter, parameter
from preisach_jax.fit import finished, plane_of
from preisach_jax.identify import Problem, evaluate
from preisach_jax.model import FORMAT_VERSION, Model
from preisach_jax.model.band import Band, Course, Others
from preisach_jax.model.spread import few_rows, spread_of
from preisach_jax.model.unforeseen import unforeseen
from preisach_jax.operator.plane import Plane
from preisach_jax.record import Record
from preisach_jax.record.course import reversals, time_since_reversal

RATE = 500.0
UNITS = {"input": "V", "output": "um"}


def actuator(seconds=6.0, seed=3, excitation=None, noise=0.02, start=0.0, begin=0.0):
    """A world with nothing hidden: the operator of `seed` along the excitation of another one."""
    drive = world.excitation("rich", seconds, RATE, excitation or seed, start)
    rng = np.random.default_rng(excitation or seed)
    output = world.make_world(seed).hysteresis(drive) + noise * rng.normal(size=len(drive))
    return Record.from_arrays(
        begin + np.arange(len(drive)) / RATE, drive, output, units=UNITS, name="stage.csv"
    )


@pytest.fixture(scope="module")
def record():
    return actuator()


@pytest.fixture(scope="module")
def plain(record):
    return pj.fit(record, levels=12).model


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
        chain = Chain(plane_of(problem, 4), effects)
        return loaded, finished(problem, evaluate(problem, chain, values, 1e-4), loaded).model


def without_output(record, **changes):
    """The record as a prediction sees it."""
    arrays = {"time": record.time, "input": record.input, "aux": record.aux} | changes
    blank = np.full(len(arrays["input"]), np.nan)
    return Record.from_arrays(
        arrays["time"],
        arrays["input"],
        blank,
        aux=arrays["aux"],
        initial_memory=changes.get("initial_memory", "free"),
        name="new.csv",
    )


def later(record, start, stop, shift=0.0):
    """A stretch of a record as a record of its own, its clock shifted."""
    part = record.part(start, stop)
    return without_output(part, time=part.time + shift)


# --- the file ---


def test_a_model_reads_back_to_the_last_bit(tmp_path, rich):
    record, model = rich
    path = tmp_path / "model.json"
    model.save(path)
    again = Model.load(path)
    assert again.to_json() == model.to_json()
    for new in (record, without_output(record), later(record, 1000, 2000, 500.0)):
        before, after = model.predict(new), again.predict(new)
        np.testing.assert_array_equal(after.output, before.output)
        np.testing.assert_array_equal(after.low, before.low)
        np.testing.assert_array_equal(after.high, before.high)
    assert [effect.name for effect in again.effects] == [e.name for e in model.effects]
    assert again.parameters == model.parameters
    np.testing.assert_array_equal(again.visited, model.visited)
    assert list(tmp_path.iterdir()) == [path]  # nothing unfinished is left


def test_the_file_is_strict_json_that_says_what_it_is(tmp_path, plain, record):
    budgeted = plain.with_budget(0.02, float("nan"))
    budgeted.save(tmp_path / "model.json")

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    text = (tmp_path / "model.json").read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=refuse)
    assert content["format_version"] == FORMAT_VERSION
    assert content["library_version"]
    assert content["levels"] == 12
    assert len(content["weights"]) == 78
    assert (content["low"], content["high"]) == (record.input.min(), record.input.max())
    assert content["columns"] == {"time": "time", "input": "input", "output": "output", "aux": []}
    assert content["units"] == {"time": "s", "input": "V", "output": "um"}
    assert content["identification"]["record"] == "stage.csv"
    assert content["identification"]["sha256"] == record.sha256
    assert content["sampling"] == {"step_s": pytest.approx(1 / RATE), "rows": len(record)}
    assert content["noise"] == 0.02
    assert content["discretisation"] is None


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


def test_a_place_that_does_not_exist_is_named(tmp_path, plain):
    with pytest.raises(pj.InputError, match=r"nowhere.model\.json: there is no folder"):
        plain.save(tmp_path / "nowhere" / "model.json")


def refused(path, **options):
    """The message with which a file is refused: one line that begins with its path."""
    with pytest.raises(pj.InputError) as caught:
        Model.load(path, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert len(message) < 400
    return message


@pytest.fixture
def content(plain):
    return json.loads(json.dumps(plain.to_json()))


def write(path, content):
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not valid JSON"),
        ('{"format": "preisach_jax model", "weights": [1.0, ', "not valid JSON"),
        ("[1, 2, 3]", "no model of preisach_jax"),
        ("3", "no model of preisach_jax"),
        ("null", "no model of preisach_jax"),
        ('{"verdict": "adequate"}', "no model of preisach_jax"),
        ('{"format": "preisach_jax model"}', "format version None"),
    ],
)
def test_files_that_are_no_model_are_refused(tmp_path, text, says):
    path = tmp_path / "broken.json"
    path.write_text(text, encoding="utf-8")
    assert says in refused(path)


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "model.json"
    path.write_bytes(b"\xff\xfe\x00\x01" * 40)
    assert "not valid JSON" in refused(path)


def test_a_missing_file_is_named(tmp_path):
    assert "cannot be read" in refused(tmp_path / "nothing.json")
    assert "cannot be read" in refused(tmp_path)


@pytest.mark.parametrize(
    "found", [FORMAT_VERSION + 1, 0, -1, 1.5, True, "1", "2", None, [1], {}, 10**400], ids=repr
)
def test_other_versions_are_refused(tmp_path, content, found):
    content |= {"format_version": found, "library_version": "9.9.9"}
    message = refused(write(tmp_path / "new.json", content))
    assert f"format version {found!r:.20} " in message
    assert f"reads versions 1 to {FORMAT_VERSION}; install the version that wrote it" in message
    assert "9.9.9" in message


KEYS = (
    "hysteron levels low high offset weights memory visited effects columns units "
    "identification rms_validation noise discretisation"
).split()


@pytest.mark.parametrize("key", KEYS)
def test_a_missing_entry_is_named(tmp_path, content, key):
    del content[key]
    message = refused(write(tmp_path / "model.json", content))
    assert f"({key} is missing: expected it beside" in message


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("weights", [1.0, 2.0]),
        ("weights", "many"),
        ("weights", [[1.0] * 78]),
        ("weights", [float("nan")] * 78),
        ("weights", [None] * 78),
        ("weights", [float("inf")] * 78),
        ("memory", [0.0] * 77),
        ("visited", []),
        ("levels", 11),
        ("levels", 0),
        ("levels", "twelve"),
        ("levels", None),
        ("low", 99.0),
        ("low", float("nan")),
        ("high", None),
        ("high", "high"),
        ("offset", float("nan")),
        ("offset", None),
        ("offset", [1.0]),
        ("rms_validation", float("nan")),
        ("rms_validation", "small"),
        ("noise", "loud"),
        ("hysteron", "slope"),
        ("hysteron", None),
        ("effects", "creep"),
        ("effects", [{"name": "creep"}]),
        ("effects", [{"name": "magic", "settings": {}, "parameters": {}}]),
        ("effects", [3]),
        ("columns", None),
        ("columns", {}),
        ("units", "um"),
        ("identification", {}),
        ("identification", "stage.csv"),
    ],
)
def test_damaged_entries_are_refused(tmp_path, content, key, value):
    content[key] = value
    message = refused(write(tmp_path / "model.json", content))
    assert (
        "damaged" in message or repr(key) in message or f"{key} is" in message or "magic" in message
    )


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("drift", {"value": float("nan")}),
        ("drift", {"value": None}),
        ("drift", {"value": "fast"}),
        ("drift", {"unit": None}),
        ("creep", {"value": -3.0}),
    ],
)
def test_damaged_parameters_are_refused(tmp_path, rich, name, change):
    content = json.loads(json.dumps(rich[1].to_json()))
    effect = next(effect for effect in content["effects"] if effect["name"] == name)
    first = next(iter(effect["parameters"]))
    effect["parameters"][first] |= change
    assert first in refused(write(tmp_path / "model.json", content))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("rows", "many"),
        ("inputs_sha256", None),
        ("history", [[0.0, 1.0]]),
        ("history", [[0.0, 1.0], [0.0, None]]),
        ("start_s", None),
        ("step_s", "short"),
    ],
)
def test_a_damaged_origin_is_refused(tmp_path, content, key, value):
    content["identification"][key] = value
    assert "damaged" in refused(write(tmp_path / "model.json", content))


class Leak(AddedEffect):
    name = "leak"
    share: float = 1.0

    tau_s: float = parameter("s", 0.01, 10.0, start=(1.0,), log=True)

    def coefficients(self):
        return (Parameter("gain", "{z}", -np.inf, np.inf),)

    def columns(self, signals):
        return (self.share * signals.time / (signals.time + self.tau_s))[:, None]


def test_effects_of_ones_own_are_read_when_they_are_passed(tmp_path, record):
    found = pj.fit(record, [Leak(share=0.5)], levels=4)
    path = tmp_path / "model.json"
    found.save(path)
    message = refused(path)
    assert "'leak'" in message
    assert "Model.load(path, effects=" in message
    again = Model.load(path, effects=[Leak()])
    assert again.effects[0].settings() == {"share": 0.5}
    np.testing.assert_array_equal(again.predict(record).output, found.model.predict(record).output)


# --- predicting ---


def test_the_record_itself_is_predicted_as_it_was_fitted(plain, record):
    got = plain.predict(without_output(record))
    np.testing.assert_array_equal(got.output, plain.simulate(record))
    np.testing.assert_array_equal(got.time, record.time)
    np.testing.assert_allclose(got.high - got.low, 2 * plain.half_width(record))
    np.testing.assert_allclose((got.high + got.low) / 2, got.output)
    assert np.sqrt(np.mean((got.output - record.output) ** 2)) < 1.2 * plain.rms_validation


def test_a_record_that_begins_with_it_goes_on(plain, record):
    whole = actuator(seconds=6.0)
    more = world.excitation("rich", 3.0, RATE, 8)
    time = np.concatenate([whole.time, whole.time[-1] + (1 + np.arange(len(more))) / RATE])
    path = np.concatenate([record.input, more])
    whole = without_output(record, time=time, input=path)
    got = plain.predict(whole)
    np.testing.assert_allclose(got.output[: len(record)], plain.simulate(record), atol=1e-9)
    truth = world.make_world(3).hysteresis(path)
    after = (got.output - truth)[len(record) :]
    assert np.sqrt(np.mean(after**2)) < 2 * plain.rms_validation
    np.testing.assert_allclose(got.high - got.low, 2 * plain.half_width(whole))


@pytest.mark.parametrize("cut", [700, 2100])
def test_a_direct_continuation_knows_the_history(cut):
    """Fitted on the first part, asked for the second alone, of which only the clock tells."""
    record = actuator()
    first = pj.fit(record.part(0, cut), levels=8).model
    whole = first.predict(without_output(record.part(0, len(record))))
    inside = (record.input >= first.plane.low) & (record.input <= first.plane.high)
    assert inside.all()  # the range was seen, or predict would have refused
    rest = later(record, cut, len(record))
    alone = first.predict(rest)
    gap = alone.output - whole.output[cut:]
    stroke = np.ptp(record.output)
    assert np.abs(gap).max() < 0.01 * stroke
    np.testing.assert_allclose(alone.high - alone.low, 2 * first.half_width(rest))
    # Without the clock, the memory is unknown.
    lost = first.predict(later(record, cut, len(record), shift=1000.0))
    assert np.abs(lost.output - whole.output[cut:]).max() > 5 * np.abs(gap).max() or (
        record.input[cut] in (record.input.min(), record.input.max())
    )


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
        path = np.concatenate([*_ramps(before), new.input])
        truth = world.make_world(3).hysteresis(path)[-len(new) :]
        slack = 4 * plain.rms_validation
        assert np.all(truth > got.low - slack)
        assert np.all(truth < got.high + slack)


def _ramps(levels):
    return [np.linspace(a, b, 100) for a, b in pairwise(levels)]


@pytest.mark.parametrize("stated", ["low", "high", "demagnetised"])
def test_stated_memory_is_used(plain, stated):
    new = from_the_middle()
    free = plain.predict(new)
    told = Record.from_arrays(new.time, new.input, new.output, initial_memory=stated)
    got = plain.predict(told)
    np.testing.assert_allclose(got.high - got.low, 2 * plain.half_width(told))
    expected = plain.offset + pj.simulate(plain.plane, plain.weights, new.input, initial=stated)
    np.testing.assert_allclose(got.output, expected, atol=0.02 * np.ptp(got.output))
    slack = 1e-6
    inside = (got.output >= free.low - slack) & (got.output <= free.high + slack)
    assert inside.all()
    if stated != "demagnetised":
        # Saturation is the edge of what unknown memory leaves open.
        edge = free.low if stated == "low" else free.high
        rest = plain.half_width(new) * (1 if stated == "low" else -1)
        np.testing.assert_allclose(got.output, edge + rest, atol=5e-3)


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
    with pytest.raises(pj.InputError) as caught:
        plain.predict(without_output(record, input=path))
    message = str(caught.value)
    for part in ("new.csv", "80.25 V", "sample 124", "2 such samples", "0 to 74.4681 V"):
        assert part in message, message
    assert "\n" not in message


def test_noise_on_the_input_may_leave_the_plane_a_little(plain, record):
    path = record.input + 0.3
    assert np.isfinite(plain.predict(without_output(record, input=path)).output).all()


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
    more = world.excitation("rich", 3.0, RATE, 8)
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


def test_a_clock_that_was_set_back_starts_drift_anew(rich):
    record, model = rich
    gap = {"input": np.append(37.0, record.input[1:])}  # not the record that was fitted
    now, before = (
        model.predict(without_output(record, time=record.time + shift, **gap))
        for shift in (0.0, -1000.0)
    )
    np.testing.assert_allclose(before.output, now.output, atol=1e-6)


def test_a_prediction_of_one_sample_and_of_a_rest(plain):
    one = Record.from_arrays([1e4, 1e4 + 1], [75.0, 75.0], [np.nan, np.nan])
    got = plain.predict(one)
    assert got.output[0] == got.output[1]
    saturated = plain.offset + plain.weights.sum()
    assert got.output[0] == pytest.approx(saturated, abs=1e-6)


def test_a_short_record_is_fitted():
    """The fewest samples that are taken; whatever is warned of is an error in these tests."""
    record = actuator()
    few = np.linspace(0, len(record) - 1, 50).astype(int)
    short = Record.from_arrays(record.time[few], record.input[few], record.output[few])
    found = pj.fit(short, ("drift",), levels=4)
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
    course = Course.of(record)
    rng = np.random.default_rng(3)
    residual = rng.normal(size=40000)
    residual[np.abs(course.speed - np.median(course.speed)) < 3] *= 3
    spread = np.zeros((40000, 2))
    band = Band.calibrated(course, residual, spread, 0.5, 0.0, NO_OTHERS)
    speed = np.abs(np.gradient(record.input, record.time))
    since = time_since_reversal(record.time, record.input)
    np.testing.assert_array_equal(course.since, since)
    assert band.law is not None
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
    course = Course.of(record)
    rng = np.random.default_rng(4)
    spread = np.abs(rng.normal(size=(20000, 2))) * [0.5, 2.0]
    usual = np.sqrt(np.mean(course.speed**2))
    true = 0.04 + 0.5 * (course.speed / usual) ** 2 + 1.5 * np.exp(-course.travel / 0.5)
    true += 3.0 * spread[:, 1] ** 2
    residual = rng.normal(size=20000) * np.sqrt(true)
    band = Band.calibrated(course, residual, spread, 0.5, 0.0, NO_OTHERS)
    assert band.law is not None
    found = band.law.deviation(course, spread) ** 2
    assert np.median(np.abs(np.log(found / true))) < 0.1
    half, fresh = band.along(course, spread), rng.normal(size=20000) * np.sqrt(true)
    for part in (course.speed, course.travel, spread[:, 1]):
        third = np.digitize(part, np.quantile(part, (1 / 3, 2 / 3)))
        for k in range(3):
            assert 0.93 < np.mean(np.abs(fresh[third == k]) <= half[third == k]) < 0.97


def test_slices_of_few_rows_have_the_width_of_all():
    record = wandering(200)
    residual = np.random.default_rng(0).normal(size=200)
    band = Band.calibrated(Course.of(record), residual, np.zeros((200, 2)), 1.0, 0.0, NO_OTHERS)
    assert np.ptp(band.half) == 0


def test_no_band_is_narrower_than_the_noise():
    record = wandering(2000)
    course, none = Course.of(record), np.zeros((2000, 2))
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
    found = unforeseen(chain, {"drift": {}}, numbers, (2.0, 12.0), 12.0 + lags, True)
    time = np.linspace(0, 10, 5001)
    course = np.cos(np.pi * time[:, None] / 10 * [1, 2, 3]) @ added
    expected = [np.sqrt(np.mean((course[k:] - course[:-k]) ** 2)) for k in (500, 1250, 2500)]
    np.testing.assert_array_equal(found[:2], 0)
    np.testing.assert_allclose(found[2:5], expected, rtol=0.01)
    np.testing.assert_allclose(found[5], 2 * found[4], rtol=0.01)  # variance grows with time
    found = unforeseen(chain, {"drift": {}}, numbers, (2.0, 12.0), lags, False)
    np.testing.assert_allclose(found, np.sqrt(2) * course.std(), rtol=0.01)
    straight = Chain(chain.plane, (Drift(horizon_s=10.0),))
    numbers = replace(numbers, added=np.array([1.0]))
    values = {"drift": {"tau_s": 300.0}}
    assert not unforeseen(straight, values, numbers, (2.0, 12.0), 12.0 + lags, True).any()


def test_long_records_are_thinned_without_losing_a_turn():
    record = wandering(30000)
    kept = few_rows(record)
    assert len(kept) == 8000
    assert set(reversals(record.input, 0.002 * np.ptp(record.input))) <= set(kept.tolist())
    assert (kept[0], kept[-1]) == (0, 29999)


def test_a_band_comes_back_from_its_file(plain, record):
    again = Model.from_json(json.loads(json.dumps(plain.to_json())))
    np.testing.assert_array_equal(again.half_width(record), plain.half_width(record))
    for key, wrong, said in (
        ("weights", ["1"], "band.others.weights is a list of 1: expected 28, as many as offset"),
        ("weights", ["1 x"] * 28, r"band.others.weights\[0\] is '1 x': expected a text of whole"),
        ("weights", ["9" * 400] * 28, r"band.others.weights\[0\] is .*: expected a text of whole"),
        ("step", [1.0], "band.others.step is a list of 1: expected 28, as many as offset has"),
        ("added", [[1.0]] * 28, r"band.others.added\[0\] is a list of 1: expected 0"),
    ):
        content = plain.to_json()
        content["band"]["others"][key] = wrong
        with pytest.raises(pj.InputError, match=said):
            Model.from_json(content)


def test_a_file_without_a_band_has_that_of_the_whole(plain, record):
    content = plain.to_json()
    del content["band"]
    older = Model.from_json(content)
    assert older.band is None
    np.testing.assert_array_equal(older.half_width(record), 1.96 * plain.rms_validation)
    content = plain.to_json()
    content["band"] = {"speed": [1.0, 2.0], "since_s": [0.1, 0.2], "half": [0.5] * 9}
    np.testing.assert_array_equal(Model.from_json(content).half_width(record), 0.5)
    content = plain.to_json()
    content["band"]["half"] = content["band"]["half"][:4]
    with pytest.raises(pj.InputError, match=r"band.half is a list of 4: expected 9"):
        Model.from_json(content)
