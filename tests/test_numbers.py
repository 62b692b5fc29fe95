"""Numbers of files and arrays are kept as they are, and only regular files are read."""

import os
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from preisach_jax import InputError, Model, OnlineFilter, Plane, Record, Sweep
from preisach_jax.effects import resolve
from preisach_jax.fit.stepwise import checked_levels
from preisach_jax.model import without_effects
from preisach_jax.plant import simulate_stage
from preisach_jax.record.reading import read_table

U, Z = np.sin(np.arange(60.0)), np.cos(np.arange(60.0))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes of a name")
@pytest.mark.parametrize("load", [Model.load, OnlineFilter.load, Sweep.load, read_table])
def test_only_regular_files_are_opened(tmp_path, load):
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/zero"), tmp_path / "pipe"):
        with pytest.raises(InputError, match=f"^{path}: this is a .*(device|pipe)[:;] "):
            load(path)


@pytest.mark.parametrize("levels", [np.nan, np.inf, "9", 10**5000, -(10**5000)], ids=type)
def test_levels_that_are_none_are_refused_in_one_line(levels):
    for make in (lambda: Plane(levels, 0.0, 1.0), lambda: checked_levels(levels)):
        with pytest.raises(InputError, match=r"^levels is .{3,31}[:;] give an? ") as caught:
            make()
        assert len(str(caught.value)) < 120


def test_one_name_is_no_list_of_names():
    for ask in (
        lambda: resolve("drift", {}),
        lambda: simulate_stage(1, effects="drift"),
        lambda: without_effects(cast(Any, None), "drift"),
    ):
        with pytest.raises(InputError, match=r"is 'drift': give a list of names"):
            ask()
    with pytest.raises(InputError, match="effects holds None, a NoneType"):
        resolve(cast(Any, [None]), {})


@pytest.mark.parametrize("ending", ["npz", "json"])
def test_stamps_of_nanoseconds_keep_every_digit(tmp_path, ending):
    stamps = np.uint64(1_700_000_000_000_000_000) + np.arange(60, dtype=np.uint64) * np.uint64(1000)
    path = tmp_path / f"n.{ending}"
    if ending == "npz":
        np.savez(path, t_ns=stamps, u=U, z=Z)
    else:
        path.write_text(f'{{"t_ns": {stamps.tolist()}, "u": {U.tolist()}, "z": {Z.tolist()}}}')
    record = Record.load(path, time="t_ns", input="u", output="z")
    np.testing.assert_allclose(np.diff(record.time), 1e-6, rtol=1e-9)


def test_arrays_keep_their_unit_their_mask_and_no_complex_half():
    time = np.datetime64("2024-01-01", "ns") + np.arange(60) * np.timedelta64(1000, "ns")
    masked = np.ma.array(Z, mask=np.arange(60) == 7)
    record = Record.from_arrays(time, U, masked)
    np.testing.assert_allclose(np.diff(record.time), 1e-6, rtol=1e-9)
    assert np.flatnonzero(~record.measured).tolist() == [7]
    with pytest.raises(InputError, match="complex"):
        Record.from_arrays(np.arange(60.0), U, Z + 0j)


@pytest.mark.parametrize("column", ["time", "input", "output", "load"])
@pytest.mark.parametrize("scale", [1e-300, 1e-162, 1e160, 1e306])
def test_numbers_that_cannot_be_computed_with_are_refused_in_one_line(tmp_path, column, scale):
    columns = {"time": np.arange(60.0), "input": U, "output": Z, "load": U * Z}
    columns[column] = columns[column] * scale
    path = tmp_path / "a.csv"
    names, rows = ",".join(columns), np.stack([*columns.values()], axis=1)
    np.savetxt(path, rows, fmt="%.17g", delimiter=",", header=names, comments="")
    told = rf"column {column}: .* compute with \(.*; give the column in another unit"
    for make in (
        lambda: Record.load(path, time="time", input="input", output="output", aux=("load",)),
        lambda: Record.from_arrays(*[*columns.values()][:3], aux={"load": columns["load"]}),
    ):
        with pytest.raises(InputError, match=told) as caught:
            make().check_identifiable()
        assert "\n" not in str(caught.value)
