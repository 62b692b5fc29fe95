"""A batch shared among devices and among processes: equal results, and failures that help."""

import json
import os
import socket
import subprocess
import sys

import jax
import numpy as np
import pytest
from oracles import PLANE, wandering

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.devices import connect
from preisach_jax.errors import InputError
from preisach_jax.sweep import Sweep, storage
from preisach_jax.work.chunks import Chunks

WORDS = "sweep --levels 3 --noise 0.1,0.4 --seeds 4 --samples 1000 --seed 5 --chunk 2".split()


def free_port():
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        return place.getsockname()[1]


# Speaks of what it computes, and does what it is told before the second chunk.
PROCESS = """
import os, signal, sys
import preisach_jax.devices as devices
from preisach_jax.cli import main
from preisach_jax.sweep import storage

devices.CONNECTING_S = int(sys.argv[2])
genuine, chunks = storage.sweep, []

def told(*arguments):
    chunks.append(arguments[3])
    if len(chunks) == 2 and sys.argv[1] == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    found = genuine(*arguments)
    print("computed", arguments[3], flush=True)
    return found

storage.sweep = told
sys.exit(main(sys.argv[3:]))
"""


def begun(out, process, port, then="go on", patience=60):
    place = ["--coordinator", f"127.0.0.1:{port}", "--processes", "2", "--process", str(process)]
    return subprocess.Popen(
        [sys.executable, "-c", PROCESS, then, str(patience), *WORDS, "--out", str(out), *place],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def same(found, expected):
    for name in found.AXES:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12)
    for one, other in zip(found.weights, expected.weights, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("alone")
    assert main([*WORDS, "--out", str(folder)]) == 0
    return Sweep.load(folder)


DEVICES = """
import sys
import jax
jax.config.update("jax_num_cpu_devices", 3)
jax.config.update("jax_enable_x64", True)
import numpy as np
import preisach_jax as pj
from preisach_jax.devices import compiled, evenly

assert evenly(5) == 6
where = compiled(lambda _, rows: rows, 0.0, jax.ShapeDtypeStruct((6,), np.float32))
shards = where(0.0, np.arange(6, dtype=np.float32)).addressable_shards
assert [len(one.data) for one in shards] == [2, 2, 2]
pj.sweep(jax.random.key(5), (3,), (0.1, 0.4), 4, 1000).save(sys.argv[1])
x = np.load(sys.argv[2])
np.save(sys.argv[2], pj.run_fleet(pj.AdaptiveFilter(pj.Plane(5, -2.0, 8.0)), x, 2 * x).weights)
"""


@pytest.mark.slow
def test_three_devices_compute_what_one_does(alone, x64, tmp_path):
    """A sweep and a fleet, whose entries the devices do not share evenly."""
    paths = tmp_path / "sweep.npz", tmp_path / "fleet.npy"
    x = np.stack([wandering(seed=seed) for seed in range(4)])
    np.save(paths[1], x)
    # Its devices are parts of the processor, whatever these tests run on.
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, "-W", "error", "-c", DEVICES, *map(str, paths)]
    subprocess.run(command, check=True, env=environment)
    same(Sweep.load(paths[0]), alone)
    here = pj.run_fleet(pj.AdaptiveFilter(PLANE), x, 2 * x).weights
    np.testing.assert_allclose(np.load(paths[1]), here, atol=1e-12)


@pytest.mark.slow
def test_two_processes_share_a_sweep_and_where_one_dies_it_resumes(alone, tmp_path, capsys):
    """What both have computed, each its half of the seeds, is what one computes alone."""
    out, port = tmp_path / "sweep", free_port()
    first, second = begun(out, 0, port), begun(out, 1, port, then="die")
    said = "".join(second.communicate(timeout=200))
    told, error = first.communicate(timeout=200)
    assert first.returncode == 2, error
    message = error.strip().splitlines()[-1]
    assert message.startswith("preisach: another process of the 2 ended or cannot be reached")
    assert "start all of them again" in message
    assert "Traceback" not in error
    assert "Gloo" not in told
    assert "computed [0, 1]" in said
    assert "computed [0, 1]" in told + error
    done = out / "done" / "seeds_0000-0001.json"
    assert [*done.parent.iterdir()] == [done]
    assert not (out / "sweep.json").exists()

    written = done.stat().st_mtime_ns
    assert main([*WORDS, "--out", str(out)]) == 0  # by one process, what two began
    assert done.stat().st_mtime_ns == written
    same(Sweep.load(out), alone)
    assert json.loads((out / "sweep.json").read_text())["seeds"] == [0, 1, 2, 3]
    capsys.readouterr()


@pytest.mark.slow
def test_processes_that_never_come_are_told(tmp_path):
    port = free_port()
    lonely = begun(tmp_path / "sweep", 1, port, patience=1)
    _, error = lonely.communicate(timeout=100)
    assert lonely.returncode == 2
    message = error.strip().splitlines()[-1]
    assert message.startswith(
        f"preisach: the other processes were not reached at 127.0.0.1:{port} (no answer in 1"
    )
    assert "start as many processes as you say there are" in message
    assert "Traceback" not in error
    assert not (tmp_path / "sweep").exists()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("node:1", 2, None), "^process is missing: give all three of coordinator, proc"),
        ((None, 2, None), "^coordinator and process is missing"),
        (("node", 2, 0), "coordinator is 'node': give HOST:PORT"),
        (("node:1", 0, 0), "processes is 0"),
        (("node:1", 2, 2), "process is 2 of 2 processes: give a number from 0 to 1"),
    ],
)
def test_numbers_that_do_not_fit_are_told_before_anything_starts(given, message):
    with pytest.raises(InputError, match=message):
        connect(*given)


def test_options_that_do_not_fit_are_told_by_their_names(tmp_path, capsys):
    for words, message in [
        (["--processes", "2"], "preisach: --coordinator and process is missing"),
        (["--distributed"], "preisach: no scheduler such as Slurm or Open MPI was found"),
    ]:
        assert main([*WORDS, "--out", str(tmp_path / "sweep"), *words]) == 2
        assert capsys.readouterr().err.startswith(message)
    assert not (tmp_path / "sweep").exists()


# --- memory and disk ---


def test_a_chunk_that_is_too_large_is_halved_and_said_so(alone, tmp_path, capsys, monkeypatch):
    genuine, tried = storage.sweep, []

    def small(key, levels, noise, seeds, samples):
        tried.append(list(seeds))
        if len(seeds) > 2:
            raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 9 bytes")
        return genuine(key, levels, noise, seeds, samples)

    monkeypatch.setattr(storage, "sweep", small)
    words = [*WORDS[:-1], "4"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    assert tried == [[0, 1, 2, 3], [0, 1], [2, 3]]
    shown = capsys.readouterr().out
    assert "too little memory for 4 seeds at once: 2 are taken" in shown
    same(Sweep.load(tmp_path), alone)


def test_a_full_disk_keeps_what_was_finished(tmp_path, capsys, monkeypatch):
    genuine, calls = Chunks._group, []

    def full(self, arrays):
        calls.append(self)
        if len(calls) == 2:
            raise OSError(28, "No space left on device")
        return genuine(self, arrays)

    monkeypatch.setattr(Chunks, "_group", full)
    assert main([*WORDS, "--out", str(tmp_path)]) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert f"{tmp_path / 'sweep.zarr'}: cannot be written (No space left on device)" in message
    assert "what was finished stays" in message
    assert [path.name for path in (tmp_path / "done").iterdir()] == ["seeds_0000-0001.json"]
    assert main([*WORDS, "--out", str(tmp_path)]) == 0


def test_what_is_not_computed_yet_is_no_number_on_disk(tmp_path, monkeypatch):
    xarray = pytest.importorskip("xarray")
    genuine = storage.sweep

    def interrupted(key, levels, noise, seeds, samples):
        if seeds[0] > 1:
            raise KeyboardInterrupt
        return genuine(key, levels, noise, seeds, samples)

    monkeypatch.setattr(storage, "sweep", interrupted)
    assert main([*WORDS, "--out", str(tmp_path)]) == 130
    read = xarray.open_zarr(tmp_path / "sweep.zarr", consolidated=False, mask_and_scale=False)
    assert np.isfinite(read["noise_part"][..., :2]).all()
    assert np.isnan(read["noise_part"][..., 2:]).all()
    assert (read["events"][..., 2:] == -1).all()
