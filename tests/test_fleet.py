"""A fleet of records gives what each of them gives alone, on any number of devices."""

import os
import subprocess
import sys

import numpy as np
import pytest

from preisach_jax.errors import InputError
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.fleet import fleet_to_folder, run_fleet
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import hysteron_states

PLANE = Plane(levels=6, low=0.0, high=10.0)
LENGTHS = (400, 900, 650, 120, 900)


def records(dtype=float):
    rng = np.random.default_rng(3)
    rows = []
    for length in LENGTHS:
        x = np.abs(np.cumsum(rng.normal(size=length)) % 20.0 - 10.0)
        rows.append((x.astype(dtype), (2.0 * x + 0.1 * rng.normal(size=length)).astype(dtype)))
    return [x for x, _ in rows], [z for _, z in rows]


@pytest.mark.parametrize(
    ("options", "passes"),
    [({}, 1), ({"step_size": 0.3}, 3), ({"hysteron": "ramp"}, 2), ({"sampling": "sample"}, 1)],
)
def test_each_record_gives_what_it_gives_alone(precision, tolerance, options, passes):
    inputs, outputs = records(precision)
    adaptive = AdaptiveFilter(PLANE, **options)
    found = run_fleet(adaptive, inputs, outputs, passes)
    for k, (x, z) in enumerate(zip(inputs, outputs, strict=True)):
        alone = adaptive.run(x, z, passes=passes, form="dense")
        np.testing.assert_allclose(found.weights[k], alone.weights, atol=50 * tolerance)
        updated = np.asarray(alone.switched) > 0
        assert found.updates[k] == updated.sum()
        rms = np.sqrt(np.mean(np.asarray(alone.error)[updated] ** 2))
        np.testing.assert_allclose(found.error[k], rms, rtol=50 * tolerance)
        states = np.asarray(hysteron_states(PLANE, x, "low", adaptive.hysteron))
        left = z - states @ np.asarray(alone.weights)
        expected = np.std(left.astype(float))
        np.testing.assert_allclose(found.replay_error[k], expected, rtol=2000 * tolerance)
        np.testing.assert_allclose(found.offset[k], left.mean(), atol=2000 * tolerance)


def test_missing_outputs_are_left_out(x64):
    inputs, outputs = records()
    outputs[1][50:70] = np.nan
    found = run_fleet(AdaptiveFilter(PLANE), inputs, outputs)
    for k in range(len(inputs)):
        alone = AdaptiveFilter(PLANE).run(inputs[k], outputs[k])
        np.testing.assert_allclose(found.weights[k], alone.weights, atol=1e-9)


def test_a_second_fleet_of_the_shape_compiles_nothing(x64, compilations):
    inputs, outputs = records()
    run_fleet(AdaptiveFilter(PLANE), inputs, outputs)
    assert compilations(lambda: run_fleet(AdaptiveFilter(PLANE), inputs, inputs)) == []


def test_a_fleet_as_two_arrays_and_one_that_never_moves(x64):
    inputs, outputs = records()
    x, z = (np.stack([row[:120] for row in side]) for side in (inputs, outputs))
    x[2] = 5.1
    found = run_fleet(AdaptiveFilter(PLANE), x, z)
    assert found.weights.shape == (5, PLANE.cells)
    assert found.updates[2] == 0
    assert np.isnan(found.error[2])
    np.testing.assert_allclose(found.weights[2], 1e-9)


DEVICES = """
import sys
import jax
jax.config.update("jax_num_cpu_devices", 3)
jax.config.update("jax_enable_x64", True)
import numpy as np
from test_fleet import PLANE, records
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.fleet import run_fleet

assert jax.device_count() == 3
np.save(sys.argv[1], run_fleet(AdaptiveFilter(PLANE), *records()).weights)
"""


@pytest.mark.slow
def test_three_devices_share_a_fleet(x64, tmp_path, request):
    path = tmp_path / "weights.npy"
    folder = request.path.parent
    # Its devices are parts of the processor, whatever these tests run on.
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, "-c", DEVICES, str(path)]
    subprocess.run(command, check=True, cwd=folder, env=environment)
    here = run_fleet(AdaptiveFilter(PLANE), *records()).weights
    np.testing.assert_allclose(np.load(path), here, atol=1e-12)


@pytest.mark.parametrize(
    ("inputs", "outputs", "passes", "message"),
    [
        ([[1.0, 2.0]], [], 1, "there are 1 inputs and 0 outputs"),
        ([], [], 1, "there are 0 inputs"),
        ([[1.0, 2.0], [1.0, 11.0]], [[0.0, 1.0], [0.0, 1.0]], 1, "record 1: .*11"),
        ([[1.0, 2.0], [1.0]], [[0.0, 1.0], [0.0, 1.0]], 1, "record 1: .*shape"),
        ([[1.0, 2.0]], [[0.0, np.inf]], 1, "record 0: .*inf"),
        ([[1.0, 2.0]], [[0.0, 1.0]], 0, "passes is 0"),
    ],
)
def test_unsound_records_are_told_by_their_number(inputs, outputs, passes, message):
    with pytest.raises(InputError, match=message):
        run_fleet(AdaptiveFilter(PLANE), inputs, outputs, passes)


def test_what_is_no_filter_or_no_fleet_is_told():
    adaptive = AdaptiveFilter(PLANE)
    with pytest.raises(InputError, match="the filter is Plane"):
        run_fleet(PLANE, [[1.0]], [[1.0]])  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="the inputs are NoneType"):
        run_fleet(adaptive, None, [[1.0]])  # pyright: ignore[reportArgumentType]


def test_a_fleet_goes_on_in_its_folder(x64, tmp_path, monkeypatch):
    adaptive, pairs = AdaptiveFilter(PLANE), list(zip(*records(), strict=True))
    whole = run_fleet(adaptive, *records())
    calls, genuine = [], run_fleet

    def interrupted(adaptive, inputs, outputs, passes):
        calls.append(len(inputs))
        if len(calls) == 2:
            raise KeyboardInterrupt
        return genuine(adaptive, inputs, outputs, passes)

    monkeypatch.setattr("preisach_jax.filter.fleet.run_fleet", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fleet_to_folder(tmp_path, adaptive, pairs, chunk=2)
    done = [path.name for path in (tmp_path / "done").iterdir()]
    assert done == ["records_0000-0001.json"]
    found = fleet_to_folder(tmp_path, adaptive, pairs, chunk=2)
    assert found is not None
    assert calls == [2, 2, 2, 1]
    for one, other in zip(found, whole, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    fleet_to_folder(tmp_path, adaptive, pairs, chunk=2)
    assert calls == [2, 2, 2, 1]
    # More records continue it, in any order; other records, and another filter, do not.
    extra = (pairs[0][0], pairs[0][1] + 1.0)
    found = fleet_to_folder(tmp_path, adaptive, [extra, *pairs[::-1]], chunk=2)
    assert found is not None
    assert calls == [2, 2, 2, 1, 2]
    np.testing.assert_allclose(found.weights[1:], whole.weights[::-1], atol=1e-12)
    assert found.offset[0] == pytest.approx(whole.offset[0] + 1.0)
    with pytest.raises(InputError, match="holds a fleet with records 6 and not 5"):
        fleet_to_folder(tmp_path, adaptive, pairs, chunk=2)
    with pytest.raises(InputError, match="holds a fleet with passes 1 and not 2"):
        fleet_to_folder(tmp_path, adaptive, [*pairs, extra], passes=2, chunk=2)


def test_what_is_no_list_of_pairs_or_names_is_told(tmp_path):
    adaptive, pairs = AdaptiveFilter(PLANE), list(zip(*records(), strict=True))
    with pytest.raises(InputError, match="give input and output of each"):
        fleet_to_folder(tmp_path, adaptive, [pairs[0], None])  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="there are 2 names of 5 records"):
        fleet_to_folder(tmp_path, adaptive, pairs, ["a", "b"])


def test_any_reader_opens_the_arrays_of_a_fleet(x64, tmp_path):
    xarray = pytest.importorskip("xarray")
    found = fleet_to_folder(tmp_path, AdaptiveFilter(PLANE), list(zip(*records(), strict=True)))
    assert found is not None
    read = xarray.open_zarr(tmp_path / "fleet.zarr", consolidated=False)
    assert read["weights"].dims == ("record", "cell")
    np.testing.assert_array_equal(read["weights"], found.weights)
    assert read.attrs["levels"] == PLANE.levels
    assert read.attrs["names"] == ["0", "1", "2", "3", "4"]
