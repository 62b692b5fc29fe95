"""Records from and to data frames, datasets and simulated responses."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lsim
from test_laws_record import assert_same

from preisach_jax.errors import InputError
from preisach_jax.record.core import Record

pd = pytest.importorskip("pandas")
xr = pytest.importorskip("xarray")

K = 80
RNG = np.random.default_rng(5)
TIME = np.cumsum(RNG.uniform(0.5, 1.5, K)) / 7
DRIVE, STROKE, LOAD = RNG.normal(size=(3, K)) * 1e3
STROKE[10:13] = np.nan


# pandas


def test_names_and_units_of_columns_come_back_from_a_frame_and_a_dataset():
    columns = {"t_ms": 1000 * TIME, "drive": DRIVE, "gauge_um": STROKE, "load_N": LOAD}
    told = {"input": "drive", "output": "gauge_um", "aux": ["load_N"], "units": {"drive": "kV"}}
    record, notes = Record.from_pandas(pd.DataFrame(columns), time="t_ms", **told), []
    own = Record.from_pandas(record.to_pandas(), announce=notes.append)
    assert not any("guessed" in note for note in notes)
    dataset = record.to_xarray()
    assert dataset["time"].attrs["units"] == "s"
    for found in (own, Record.from_xarray(dataset)):
        assert_same(found, record)
        for role in ("input", "output", "load_N"):
            assert found.channels[role] == record.channels[role]


@pytest.mark.parametrize(
    "index",
    [
        pd.to_timedelta(np.arange(K) * 25, unit="ms"),
        pd.date_range("2024-03-01 12:00:00.125", freq="25ms", periods=K, tz="Europe/Berlin"),
        pd.Index(np.arange(K) * 25, name="t_ms"),
    ],
    ids=["durations", "dates in a zone", "named"],
)
def test_the_index_may_be_the_time(index):
    frame = pd.DataFrame({"u_V": DRIVE, "z_um": STROKE}, index=index)
    record = Record.from_pandas(frame)
    np.testing.assert_array_equal(record.time, np.arange(K) * 25 / 1000)
    np.testing.assert_array_equal(record.input, DRIVE)


def test_missing_values_of_pandas_are_empty_cells():
    columns = pd.array(np.arange(K) % 9, dtype="Int64"), pd.array(DRIVE, dtype="Float64")
    frame = pd.DataFrame({"t": TIME, "u": columns[0], "z": columns[1]})
    frame.loc[7, "z"] = pd.NA
    record = Record.from_pandas(frame)
    np.testing.assert_array_equal(record.input, np.arange(K) % 9)
    assert list(np.flatnonzero(~record.measured)) == [7]
    frame.loc[5, "u"] = pd.NA
    with pytest.raises(InputError, match="stage, column u, row 6: the cell is empty"):
        Record.from_pandas(frame, input="u", name="stage")


@pytest.mark.parametrize(
    ("frame", "options", "expected"),
    [
        ([1, 2], {}, "frame: this is a list; give a pandas.DataFrame"),
        (pd.DataFrame([[1, 2]] * K, columns=["u", "u"]), {}, "'u' stands 2 times"),
        (pd.DataFrame({"t": TIME, "u": DRIVE > 0, "z": STROKE}), {"input": "u"},
         "column u, row 1: '(True|False)' is not a number"),
        (pd.DataFrame({"t": TIME[::-1], "u": DRIVE, "z": STROKE}), {}, "row 2: time runs backw"),
        (pd.DataFrame({"t": [], "u": [], "z": []}), {}, "there are no rows; give at least 2"),
        (pd.DataFrame({"t": TIME, "drive": DRIVE, "z": STROKE, "input": LOAD}),
         {"input": "drive", "aux": ["input"]}, "frame: an auxiliary column is called 'input'"),
    ],
)  # fmt: skip
def test_frames_that_are_no_record(frame, options, expected):
    with pytest.raises(InputError, match=expected):
        Record.from_pandas(frame, **options)


# xarray


def test_a_dataset_of_another_make():
    field, moment = ("when", DRIVE, {"units": "mT"}), ("when", STROKE, {"units": "emu"})
    dataset = xr.Dataset(
        {"field": field, "moment": moment, "image": (("x", "y"), np.zeros((3, 4)))},
        coords={"when": pd.date_range("2024-03-01", freq="25ms", periods=K)},
    )
    record = Record.from_xarray(dataset)
    np.testing.assert_array_equal(record.time, np.arange(K) * 25 / 1000)
    np.testing.assert_array_equal(record.input, DRIVE)
    assert (record.input_unit, record.output_unit) == ("mT", "emu")
    assert record.name == "dataset"


def test_what_is_no_dataset_is_refused_and_without_xarray_the_package_is_named(monkeypatch):
    with pytest.raises(InputError, match=r"dataset: this is a ndarray; give an xarray.Dataset"):
        Record.from_xarray(np.zeros(3))  # pyright: ignore[reportArgumentType]
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match=r"pip install 'preisach_jax\[xarray\]'"):
        Record.from_arrays(TIME, DRIVE, STROKE).to_xarray()


# Responses


def response_of(time, inputs, outputs):
    """What python-control gives: an object with these."""
    return SimpleNamespace(time=time, inputs=inputs, outputs=outputs)


@pytest.mark.parametrize("alone", [True, False], ids=["one signal", "of several"])
def test_responses_that_hold_their_input(alone):
    axes = () if alone else (None,)
    response = response_of(TIME, DRIVE[axes], STROKE[2 * axes])
    record = Record.from_response(response, units={"input": "V"}, name="loop")
    for own, given in zip(record.to_arrays(), (TIME, DRIVE, STROKE), strict=True):
        np.testing.assert_array_equal(own, given)
    assert (record.input_unit, record.name) == ("V", "loop")


def test_a_response_of_scipy_takes_its_input_beside():
    t = np.arange(K) / 10
    response = lsim(([1.0], [0.5, 1.0]), np.ones(K), t)
    record = Record.from_response(response, input=np.ones(K))
    np.testing.assert_allclose(record.output, 1 - np.exp(-2 * t), atol=1e-12)
    np.testing.assert_array_equal(record.input, np.ones(K))


@pytest.mark.parametrize(
    ("response", "options", "expected"),
    [
        ((TIME, STROKE), {}, "of 2 arrays; give .time, input, output."),
        (response_of(TIME, None, STROKE), {}, "holds no input; give it as input="),
        (response_of(TIME, DRIVE, np.zeros((2, K))), {}, r"output: an array of shape \(2, 80\)"),
        (STROKE, {}, "this is a ndarray; give an object with time"),
    ],
)
def test_responses_that_are_no_record(response, options, expected):
    with pytest.raises(InputError, match=expected):
        Record.from_response(response, **options)
