"""Killed processes and full disks: no file is half there."""

import errno
import os
from pathlib import Path

from preisach_jax.cli import main
from preisach_jax.files import write_files


def test_what_killed_writers_left_is_removed_and_what_others_write_is_not(tmp_path):
    killed, living, foreign = (
        tmp_path / f".a.json.0123abcd.{owner}.part" for owner in (999_999_999, os.getppid(), "mine")
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


def test_whatever_fails_on_the_way_is_told_and_old_results_stay(tmp_path, monkeypatch, capsys):
    old = tmp_path / "stage.csv"
    old.write_text("old")

    def fail(*_):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("os.replace", fail)
    assert main(["simulate", "--seconds", "3", "--quiet", "--out", str(old), "--force"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert message.startswith(f"preisach: {old}: cannot be written ({os.strerror(errno.EIO)})")
    assert "the disk fails" in message
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]
