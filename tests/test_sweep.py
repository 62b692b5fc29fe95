"""The noise sweep against runs one by one, its exponents against SciPy, and its folders."""

import dataclasses
import json
import sys
from typing import Any

import jax
import numpy as np
import pytest
from scipy import stats

from preisach_jax import AdaptiveFilter, InputError, Plane, Sweep
from preisach_jax.operator.states import hysteron_states
from preisach_jax.paper.sweep import (
    fit_power_law,
    merge,
    realisation,
    sweep,
    sweep_to_folder,
    true_weights,
)
from preisach_jax.theory import largest_slope

# One setting for these tests and those of the command, so that little has to be compiled.
LEVELS, NOISE, SEEDS, SAMPLES, CHUNK = (5, 3), (0.05, 0.2, 0.5), 2, 1000, 1
FIRST = 200
SETTINGS = (LEVELS, NOISE, SEEDS, SAMPLES)
MODULE = sys.modules[sweep.__module__]
KEY, ONES = jax.random.key(7), np.ones(2)


@pytest.fixture(scope="module")
def whole():
    return sweep(KEY, *SETTINGS)


def check_same(one, other, rtol=0.0):
    """Two sweeps agree in all that does not tell the time; to the last bit, unless `rtol` is given.

    How many seeds are computed at once may change the order in which numbers are added up.
    """
    assert one.device == other.device
    for a, b in zip(one.weights, other.weights, strict=True):
        np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol)
    apart = {"weights", "compile_s", "run_s", "device"}
    for name in {field.name for field in dataclasses.fields(Sweep)} - apart:
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=rtol)


# Against runs one by one


@jax.jit
def run_by_samples(filt, x, z):
    """Weights after each sample, (time, cells), e and A."""

    def advance(state, sample):
        state, info = filt.step(state, *sample)
        return state, (state.weights, info.error, info.switched)

    return jax.lax.scan(advance, filt.init(x[0], z[0]), (x, z))[1]


relays = jax.jit(lambda plane, x: hysteron_states(plane, x, "low", "relay"))


def outputs(plane, drawn, noise):
    """The outputs of one input, in the order of `Sweep.weights`."""
    clean = np.asarray(relays(plane, drawn.record.input_v)) @ true_weights(plane)
    stage = np.asarray(drawn.record.stroke_um)
    added = [sigma * np.asarray(drawn.noise[:, n]) for n, sigma in enumerate(noise)]
    return [one + more for one in (stage, clean) for more in (0.0, *added)]


@pytest.mark.parametrize("n", range(len(LEVELS)))
def test_a_sweep_is_the_filter_run_one_by_one(n, whole, x64):
    plane, seed = Plane(LEVELS[n], 0.0, 75.0), 1
    drawn = realisation(KEY, seed, SAMPLES, len(NOISE))
    x, truth = np.asarray(drawn.record.input_v), true_weights(plane)
    filt, paths = AdaptiveFilter(plane), []
    for lane, z in enumerate(outputs(plane, drawn, NOISE)):
        final = filt.run(x, z).weights
        np.testing.assert_allclose(whole.weights[n][seed, lane], final, rtol=1e-9, atol=1e-10)
        paths.append([np.asarray(a)[FIRST:] for a in run_by_samples(filt, x, z)])

    at = paths[0][2] > 0
    assert whole.events[n, seed] == at.sum()
    half = 1 + len(NOISE)
    expected = [np.sqrt(np.sum(e[at] ** 2) / (at.sum() - 1)) for _, e, _ in paths[:half]]  # (30)
    found = whole.output_error[n, seed], *whole.noisy_output_error[n, :, seed]
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    clean = paths[half][0]
    bias = np.mean(np.sum((clean - truth) ** 2, axis=1))
    np.testing.assert_allclose(whole.bias_squared[n, seed], bias, rtol=1e-9)
    for lane, (weights, _, _) in enumerate(paths[half + 1 :]):
        total = np.mean(np.sum((weights - truth) ** 2, axis=1))
        added = np.mean(np.sum((weights - clean) ** 2, axis=1))
        assert added > 1e-3 * NOISE[lane] ** 2
        np.testing.assert_allclose(whole.weight_error_squared[n, lane, seed], total, rtol=1e-9)
        np.testing.assert_allclose(whole.noise_part[n, lane, seed], added, rtol=1e-8)


def test_the_noise_power_is_that_of_the_greatest_slope_of_all_records(whole, x64):
    slopes = []
    for seed in range(SEEDS):
        record = realisation(KEY, seed, SAMPLES, len(NOISE)).record
        slopes.append(largest_slope(record.input_v, record.stroke_um))
    power = max(slopes) ** 2 * np.array([15, 25]) ** 2 / 12
    np.testing.assert_allclose(whole.noise_power, power, rtol=1e-9)


def test_chunks_of_seeds_join_to_the_whole_to_the_last_bit(whole):
    parts = [sweep(KEY, LEVELS, NOISE, numbers, SAMPLES) for numbers in ([0], range(1, 2))]
    joined = merge(parts)
    check_same(joined, whole)
    swapped = merge(parts[::-1])
    assert swapped.seeds.tolist() == [1, 0]
    np.testing.assert_array_equal(swapped.noise_part[:, :, 0], whole.noise_part[:, :, 1])
    with pytest.raises(InputError, match=r"samples is 1000 .* 2000"):
        merge([whole, dataclasses.replace(whole, samples=2000)])


def test_other_numbers_of_the_same_shape_compile_nothing(whole, compilations):
    sweep(KEY, *SETTINGS)
    others = []
    again = jax.random.key(8), LEVELS, (0.1, 0.2, 0.4), [5, 9], SAMPLES
    assert not compilations(lambda: others.append(sweep(*again)))
    (other,) = others
    assert not np.array_equal(other.events, whole.events)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fit_power_law(ONES, -ONES), r"fitted to -1\.0: give positive"),
        (lambda: fit_power_law(ONES, ONES), "2 points in 1 rows: give at least two more"),
        (lambda: sweep_to_folder("new", KEY, chunk=0), "chunk is 0: give a whole number"),
        (lambda: sweep(KEY, (5, 5), NOISE), "levels holds .5, 5.: name each only once"),
        (lambda: sweep(KEY, LEVELS, (0.0,)), "noise holds 0.0: .* without noise is always"),
        (lambda: sweep(KEY, *SETTINGS[:2], [1, -1]), "seeds holds -1: give a whole number of at"),
        (lambda: sweep(0, *SETTINGS), r"make one by jax\.random\.key"),  # pyright: ignore
        (lambda: sweep(np.zeros(3, np.uint32), *SETTINGS), "make one by"),  # pyright: ignore
    ],
)
def test_what_cannot_be_used_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


# What it found


def test_averages_over_all_seeds(whole):
    squares = whole.output_error**2 * (whole.events - 1)
    events = np.sqrt(squares.sum(axis=1) / (whole.events.sum(axis=1) - SEEDS))
    np.testing.assert_allclose(whole.mean_output_error(), events, rtol=1e-12)
    np.testing.assert_allclose(whole.auxiliary_norm(), events / np.sqrt([15, 6]), rtol=1e-12)
    rows = SEEDS * (SAMPLES - FIRST - 1)
    samples = np.sqrt(squares.sum(axis=1) / rows)
    np.testing.assert_allclose(whole.mean_output_error("samples"), samples, rtol=1e-12)
    with pytest.raises(InputError, match="over is 'all'"):
        whole.mean_output_error("all")
    ratio = (whole.noise_part / np.square(NOISE)[:, np.newaxis]).reshape(len(LEVELS), -1)
    np.testing.assert_allclose(whole.coefficient, ratio.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(whole.coefficient_error, stats.sem(ratio, axis=1), rtol=1e-12)


def test_rows_of_a_power_law_share_the_exponent_and_have_their_own_constants():
    rng = np.random.default_rng(1)
    x = np.geomspace(0.1, 30.0, 18).reshape(3, 6)
    y = np.array([[0.1], [3.0], [50.0]]) * x**0.8 * np.exp(rng.normal(0.0, 0.1, x.shape))
    rows = np.repeat(np.eye(3), 6, axis=0)
    columns = np.column_stack([np.log(x).ravel(), rows])
    solution, left, _, _ = np.linalg.lstsq(columns, np.log(y).ravel(), rcond=None)
    variance = left[0] / 14 * np.linalg.inv(columns.T @ columns)[0, 0]
    half = stats.t.ppf(0.975, 14) * np.sqrt(variance)
    law = fit_power_law(x, y)
    np.testing.assert_allclose(law[:3], solution[0] + half * np.array([0, -1, 1]), rtol=1e-10)
    assert law.correlation == min(np.corrcoef(*row)[0, 1] for row in zip(x, y, strict=True))


def test_exponents_are_those_of_the_points(whole):
    three = dataclasses.replace(
        whole,
        levels=np.array([9, 5, 3]),
        events=np.full((3, 1), 101),
        output_error=np.array([[1.0], [2.0], [4.0]]),
        noise_um=np.array([0.1, 1.0, 10.0]),
        noise_part=np.array([3.0, 2.0, 1.0])[:, None, None] * [[[0.01], [1.0], [100.0]]],
        seeds=np.array([0]),
    )
    laws = three.exponents()
    norm = np.array([1.0, 2.0, 4.0]) / np.sqrt([45, 15, 6])
    regression: Any = stats.linregress(-2 * np.log([9, 5, 3]), np.log(norm))  # W falls as 1/N²
    np.testing.assert_allclose(laws["paper"].value, regression.slope, rtol=1e-12)
    np.testing.assert_allclose(laws["paper_all_samples"].value, regression.slope, rtol=1e-12)
    np.testing.assert_allclose(laws["truth"].value, 1.0, rtol=1e-12)
    np.testing.assert_allclose(three.coefficient, [3.0, 2.0, 1.0], rtol=1e-12)


def test_xarray_has_named_axes_and_units(whole, monkeypatch):
    pytest.importorskip("xarray")
    dataset = whole.to_xarray()
    one = dataset["noise_part"].sel(level=3, noise=0.5, seed=1)
    assert float(one) == whole.noise_part[1, 2, 1]
    assert one.attrs["units"] == "um^2"
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match=r"pip install 'preisach_jax\[xarray\]'"):
        whole.to_xarray()


# Files


def test_what_is_saved_is_read_back_and_what_is_damaged_refused(whole, tmp_path):
    path = tmp_path / "sweep.npz"
    with pytest.raises(InputError, match=r"sweep\.npz does not exist"):
        Sweep.load(path)
    whole.save(path)
    check_same(Sweep.load(path), whole)
    assert [*tmp_path.iterdir()] == [path]
    content = path.read_bytes()
    middle = len(content) // 2
    flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    for damaged in (b"", content[:-1], flipped, b"no sweep"):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="cannot be read as a sweep"):
            Sweep.load(path)


def run_to(folder, key=KEY, **changes):
    settings = {"levels": LEVELS, "noise": NOISE, "seeds": SEEDS, "samples": SAMPLES}
    return sweep_to_folder(folder, key, **({**settings, "chunk": CHUNK} | changes))


@pytest.fixture
def computed(monkeypatch):
    """The seeds of each chunk that is really computed."""
    seen = []

    def counted(key, levels, noise, seeds, samples):
        seen.append(list(seeds))
        return sweep(key, levels, noise, seeds, samples)

    monkeypatch.setattr(MODULE, "sweep", counted)
    return seen


def test_a_folder_holds_the_sweep_and_goes_on(whole, tmp_path, computed):
    out, shown = tmp_path / "new", []
    assert run_to(out, seeds=1).seeds.tolist() == [0]
    found = run_to(out, progress=lambda *now: shown.append(now))
    check_same(found, whole, rtol=1e-12)
    check_same(Sweep.load(out), whole, rtol=1e-12)
    assert computed == [[0], [1]]
    assert shown == [("seed 2 of 2", 0.5)]
    content = json.loads((out / "sweep.json").read_text())
    assert content == json.loads(json.dumps(found.to_json()))
    # It is not repeated unless it is restarted.
    run_to(out)
    assert computed == [[0], [1]]
    run_to(out, resume=False)
    assert computed[2:] == [[0], [1]]
    names = ["seeds_0000-0000.npz", "seeds_0001-0001.npz", "sweep.json"]
    assert sorted(path.name for path in out.iterdir()) == names


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"key": jax.random.key(9)}, "with key 0,7 and not 0,9: choose another.*--restart"),
        ({"samples": 1001}, "samples 1000 and not 1001:"),
        ({"noise": (0.5,)}, r"noise 0\.05,0\.2,0\.5 and not 0\.5:"),
    ],
)
def test_a_folder_of_other_settings_is_left_alone(settings, message, whole, tmp_path, computed):
    path = tmp_path / "seeds_0000-0001.npz"
    whole.save(path)
    written = path.read_bytes()
    with pytest.raises(InputError, match=message):
        run_to(tmp_path, **settings)
    assert path.read_bytes() == written
    assert not computed
    path.write_bytes(written[:-9])
    for resume in (True, False):
        with pytest.raises(InputError, match=r"seeds_0000-0001\.npz cannot be read as a sweep"):
            run_to(tmp_path, resume=resume)
    assert path.read_bytes() == written[:-9]
    path.unlink()
    with pytest.raises(InputError, match="give a folder that a sweep wrote"):
        Sweep.load(tmp_path)


def test_too_little_memory_for_a_chunk_is_told(tmp_path, monkeypatch):
    def small(key, levels, noise, seeds, samples):
        if len(seeds) > 1:
            raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 9 bytes")
        return sweep(key, levels, noise, seeds, samples)

    monkeypatch.setattr(MODULE, "sweep", small)
    with pytest.raises(InputError, match="too small for 2 seeds at once: give a smaller chunk"):
        run_to(tmp_path, chunk=2)
    assert run_to(tmp_path).seeds.tolist() == [0, 1]


# Last, as it compiles anew what all tests above share.
def test_the_precision_of_the_caller_does_not_matter(whole, x64):
    for cache in ("_compiled_draw", "_compiled_identify"):
        getattr(MODULE, cache).cache_clear()
    check_same(sweep(KEY, *SETTINGS), whole)
    assert {rows.dtype.name for rows in whole.weights} == {"float64"}
