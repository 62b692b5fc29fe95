"""Laws of records: whatever they are written as, they are read back, to the last bit."""

import io
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays
from scipy.io import loadmat, savemat
from strategies import records

import preisach_jax as pj
from preisach_jax.record.matlab import matlab_arrays

pytest.importorskip("xarray")


def assert_same(found, record):
    """The same values to the last bit, and the same units of what has a unit."""
    for own, other in zip(found.to_arrays(), record.to_arrays(), strict=True):
        np.testing.assert_array_equal(own, other)
    assert found.sha256 == record.sha256
    assert list(found.aux) == list(record.aux)
    for name, values in record.aux.items():
        np.testing.assert_array_equal(found.aux[name], values)
    for role in ("input", "output", *record.aux):
        assert found.channels[role].unit == record.channels[role].unit


def told(record) -> dict[str, Any]:
    """What a plain file cannot say: the roles of columns and their units."""
    roles = {"time": "time", "input": "input", "output": "output", "aux": list(record.aux)}
    units = {role: record.channels[role].unit for role in ("input", "output", *record.aux)}
    return roles | {"units": units}


@settings(max_examples=10)
@given(record=records(great=True))
def test_frames_and_datasets_give_a_record_back(record):
    for found in (
        pj.Record.from_pandas(record.to_pandas()),
        pj.Record.from_xarray(record.to_xarray()),
    ):
        assert_same(found, record)
        assert (found.name, found.initial_memory) == (record.name, record.initial_memory)
    plain = pj.Record.from_arrays(*record.to_arrays())
    assert_same(pj.Record.from_response(record.to_arrays()), plain)


@settings(max_examples=15)
@given(record=records(), kind=st.sampled_from(["csv", "npz", "parquet"]))
def test_files_give_a_record_back(tmp_path_factory, record, kind):
    frame = record.to_pandas()
    path = tmp_path_factory.mktemp("records") / f"a.{kind}"
    if kind == "csv":
        frame.to_csv(path, index=False)
    elif kind == "npz":
        np.savez_compressed(path, **{name: frame[name].to_numpy() for name in frame.columns})
    else:
        pytest.importorskip("pyarrow")
        frame.to_parquet(path)
    assert_same(pj.Record.load(path, **told(record)), record)


@settings(max_examples=10)
@given(record=records(), cut=st.floats(0, 1))
def test_two_parts_hold_what_the_whole_holds(record, cut):
    k = 2 + round(cut * (len(record) - 4))
    parts = [record.part(0, k), record.part(k, len(record))]
    for position, whole in enumerate(record.to_arrays()):
        joined = np.concatenate([part.to_arrays()[position] for part in parts])
        np.testing.assert_array_equal(joined, whole)
    assert parts[0].inputs_digest(k) == record.inputs_digest(k)
    assert parts[0].initial_memory == record.initial_memory


@settings(max_examples=10)
@given(record=records(), unit=st.sampled_from([("ms", 1e3), ("us", 1e6), ("min", 1 / 60)]))
def test_the_unit_of_time_does_not_matter(record, unit):
    name, per_s = unit
    frame = record.to_pandas().rename(columns={"time": "when"})
    frame["when"] = frame["when"] * per_s
    frame.attrs.clear()
    roles = told(record)
    roles["time"] = "when"
    roles["units"]["when"] = name
    found = pj.Record.from_pandas(frame, **roles)
    np.testing.assert_allclose(found.time, record.time, rtol=1e-14)
    assert found.channels["time"].unit == name


NUMBERS = st.sampled_from("f8 f4 i1 u1 i2 u2 i4 u4 i8 u8 c16 ?".split()).map(np.dtype)
VECTORS = NUMBERS.flatmap(
    lambda dtype: arrays(dtype, st.tuples(st.integers(1, 3), st.integers(1, 5)))
)
NAMES = st.text("abcXYZ019_", min_size=1, max_size=20).map(lambda name: f"v{name}")


@settings(max_examples=15)
@given(
    content=st.dictionaries(
        NAMES,
        VECTORS | st.text("aäz", max_size=9) | st.dictionaries(NAMES, VECTORS, min_size=1),
        min_size=1,
        max_size=4,
    ),
    compress=st.booleans(),
)
def test_matlab_files_are_read_as_scipy_reads_them(content, compress):
    file = io.BytesIO()
    savemat(file, content, do_compression=compress, long_field_names=True)
    found = matlab_arrays(file.getvalue(), 10_000)
    file.seek(0)
    expected = {
        name: value
        for name, value in loadmat(file, simplify_cells=True).items()
        if not name.startswith("__")
    }
    assert list(found) == list(expected)
    for name, value in expected.items():
        if isinstance(value, dict):
            assert list(found[name]) == list(value)
            for field, inner in value.items():
                np.testing.assert_array_equal(found[name][field], inner)
        elif isinstance(value, str | list) or np.asarray(value).dtype.kind == "U":
            assert found[name] == (value if isinstance(value, str) else "")
        else:
            np.testing.assert_array_equal(found[name], value)
