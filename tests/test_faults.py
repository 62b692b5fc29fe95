"""Killed processes, full disks, folders that vanish, clocks that jump: nothing is half there."""

import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.errors import InputError
from preisach_jax.files import write_files
from preisach_jax.sweep import storage

SWEEP = ["sweep", "--levels", "3", "--noise", "0.1", "--seeds", "3", "--samples", "1000",
         "--chunk", "1"]  # fmt: skip


# Kills: of them at any moment `benchmarks/trust/faults.py` is the campaign


def test_what_killed_writers_left_is_removed_and_what_others_write_is_not(tmp_path):
    killed, living, foreign = (
        tmp_path / f".a.json.{owner}.part" for owner in (999_999_999, os.getppid(), "mine")
    )
    for path in (killed, living, foreign):
        path.write_text("half")
    write_files({tmp_path / "a.json": b"whole"})
    assert {path.name for path in tmp_path.iterdir()} == {"a.json", living.name, foreign.name}


def test_files_and_names_reach_the_disk_before_old_ones_go(tmp_path, monkeypatch):
    done, sync, replace = [], os.fsync, os.replace

    def noted_sync(descriptor):
        done.append("folder" if os.path.isdir(f"/proc/self/fd/{descriptor}") else "file")
        sync(descriptor)

    def noted_replace(source, target):
        done.append("replace")
        replace(source, target)

    monkeypatch.setattr("os.fsync", noted_sync)
    monkeypatch.setattr("os.replace", noted_replace)
    write_files({tmp_path / "a": b"1", tmp_path / "b": b"2"})
    expected = ["file", "file", "replace", "replace"]
    assert done[:4] == expected
    if Path("/proc/self/fd").exists():
        assert done == [*expected, "folder"]


# Places that take nothing


def told(capsys, words):
    """The one line with which a command ends that a user can mend."""
    assert main([str(word) for word in words]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert "Traceback" not in "".join(lines)
    assert lines[-1].startswith("preisach: ")
    return lines[-1]


SIMULATE = ["simulate", "--seconds", "3", "--rate", "2000", "--quiet"]


@pytest.mark.parametrize(
    ("where", "number", "remedy"),
    [
        ("os.fsync", errno.ENOSPC, "make room, or choose another place"),
        ("os.replace", errno.EIO, "the disk fails"),
    ],
)
def test_whatever_fails_on_the_way_is_told_and_old_results_stay(
    where, number, remedy, tmp_path, monkeypatch, capsys
):
    old = tmp_path / "stage.csv"
    old.write_text("old")

    def fail(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(where, fail)
    message = told(capsys, [*SIMULATE, "--out", old])
    assert message.startswith(f"preisach: {old}: cannot be written ({os.strerror(number)})")
    assert remedy in message
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


# Folders that change under the work


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A sweep that nothing disturbed."""
    out = tmp_path_factory.mktemp("whole") / "sweep"
    assert main([*SWEEP, "--out", str(out), "--quiet"]) == 0
    return out


def assert_same(out, whole):
    one, other = storage.load_folder(out), storage.load_folder(whole)
    for name in one.AXES:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for found, expected in zip(one.weights, other.weights, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_folder_that_is_removed_as_the_work_runs_is_told(whole, tmp_path, capsys, monkeypatch):
    out, genuine, calls = tmp_path / "sweep", storage.sweep, []

    def removing(*arguments):
        calls.append(arguments)
        if len(calls) == 2:
            shutil.rmtree(out)
        return genuine(*arguments)

    monkeypatch.setattr(storage, "sweep", removing)
    message = told(capsys, [*SWEEP, "--out", out])
    assert f"{out}: it was removed or emptied while the sweep ran; give the same" in message
    assert main([*SWEEP, "--out", str(out), "--quiet"]) == 0
    assert_same(out, whole)


def test_what_a_killed_writer_left_is_mended_or_refused_with_a_remedy(whole, tmp_path, capsys):
    out = tmp_path / "sweep"
    shutil.copytree(whole, out)
    for name in ("sweep.zarr/zarr.json", "sweep.zarr/events/zarr.json"):
        (out / name).write_bytes((out / name).read_bytes()[:20])
    (out / "done" / "seeds_0001-0001.json").unlink()
    for folder in (out, out / "done", out / "sweep.zarr", out / "sweep.zarr" / "events"):
        (folder / ".0a1b.partial").write_bytes(b"half")
        (folder / ".manifest.json.999999999.part").write_bytes(b"half")
    assert main([*SWEEP, "--out", str(out), "--quiet"]) == 0
    assert_same(out, whole)
    manifest = out / "manifest.json"
    manifest.write_bytes(manifest.read_bytes()[:100])
    assert "--restart" in told(capsys, [*SWEEP, "--out", out])
    assert main([*SWEEP, "--out", str(out), "--quiet", "--restart"]) == 0
    assert_same(out, whole)


def test_a_saved_filter_that_ends_early_is_refused_wherever_it_ends(tmp_path):
    path, cut = tmp_path / "state.npz", tmp_path / "cut.npz"
    online = pj.OnlineFilter(pj.AdaptiveFilter(pj.Plane(levels=5, low=0.0, high=1.0)))
    online(0.5, 1.0)
    online.save(path)
    content = path.read_bytes()
    for size in range(0, len(content), 211):
        cut.write_bytes(content[:size])
        with pytest.raises(InputError, match=r"cut\.npz cannot be read as a saved filter"):
            pj.OnlineFilter.load(cut)
