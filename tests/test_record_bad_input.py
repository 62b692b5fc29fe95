"""Bad records: each is refused with one line that says where, what and how to mend it."""

import re
import tracemalloc

import numpy as np
import pytest
from scipy.io import savemat
from test_record import MICROMAG, signals

from preisach_jax.errors import InputError
from preisach_jax.record.core import Record

K = 60


def rows_of_text():
    """Names and rows of a sound record as lists of cells; row 1 of the file is the names."""
    t, u, z = signals(K)
    cells = [[f"{a:.3f}", f"{b:.6f}", f"{c:.6f}"] for a, b, c in zip(t, u, z, strict=True)]
    return [["t_s", "u_V", "z_um"], *cells]


def write(path, rows):
    path.write_text("\n".join(map(",".join, rows)) + "\n")
    return path


def refusal(path, **options):
    """The message with which a record is refused; always one line that names the file."""
    with pytest.raises(InputError) as caught:
        Record.load(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert path.name in message
    assert len(message) < 400
    return message


COLUMNS = {"time": "t_s", "input": "u_V", "output": "z_um"}


@pytest.mark.parametrize(
    ("column", "cell", "expected"),
    [
        (0, "", ["empty", "--rate"]),
        (0, "0.001", ["runs backward", "0.001 after 0.09", "--rate"]),
        (0, "0.090", ["repeats", "0.09 after 0.09", "--rate"]),
        (1, "abc", ["'abc'", "not a number", "correct"]),
        (1, "", ["empty or NaN", "fill it in"]),
        (1, "-inf", ["infinite"]),
        (2, "over", ["'over'", "not a number", "leave the cell empty"]),
        (2, "inf", ["inf", "empty"]),
    ],
)
def test_a_bad_cell_is_named_with_file_column_and_row(tmp_path, column, cell, expected):
    """Whatever comments and blanks stand before its row."""
    rows = rows_of_text()
    rows[11][column] = cell
    rows[3:3] = [[""], ["# a comment"], ["   "], ["% another"]]
    rows[:0] = [["# made by a logger"]]
    for options in ({}, COLUMNS):  # guessed, named
        message = refusal(write(tmp_path / "stage.csv", rows), **options)
        assert f"column {['t_s', 'u_V', 'z_um'][column]}, row 17: " in message
        assert all(part in message for part in expected), message


def test_a_missing_file_names_one_of_a_similar_name(tmp_path):
    write(tmp_path / "stage_01.csv", rows_of_text())
    message = refusal(tmp_path / "stage_02.csv")
    assert "no such file" in message
    assert "stage_01.csv" in message
    assert "no such file" in refusal(tmp_path / "nowhere" / "stage.csv")
    assert "folder" in refusal(tmp_path)


RANDOM = np.random.default_rng(0).integers(1, 256, 3000, dtype=np.uint8).tobytes()


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (RANDOM, "the file is binary, not text; give"),
        (b"\x7fELF\x02\x01\x01" + bytes(9) + RANDOM, "it is a program"),
        (b"\x89PNG\r\n\x1a\n" + RANDOM, "a PNG picture"),
        (b"\x1f\x8b\x08" + RANDOM, "not a readable gzip file"),
        (b"PK\x03\x04" + RANDOM, "not a readable ZIP file"),
        (b"TDSm" + RANDOM, "not a readable TDMS file.*; defragment it"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + RANDOM, "not a readable workbook file"),
        (b"\x93NUMPY" + RANDOM, "not a readable NPY file"),
        (b"", "empty"),
        (b"# only a comment\n\n", "no data"),
        (b"t,u,z\n", "no row below the names"),
        (b"0,1,2\n1,2,3\n2,5,1\n", r"no names \(row 1 is numbers already\)"),
        (b"t,u,z\n0,1,2\n", "one sample"),
    ],
)
def test_files_without_a_record_are_named_by_their_content(tmp_path, content, expected):
    """Whatever their ending."""
    path = tmp_path / "stage.csv"
    path.write_bytes(content)
    assert re.search(expected, refusal(path))


def test_a_file_of_two_gigabytes_is_refused_without_being_read(tmp_path):
    path = tmp_path / "great.csv"
    with path.open("wb") as file:
        file.write(b"t_s,u_V,z_um\n0,1,2\n")
        file.truncate(2**31)  # a hole on the disk: nothing is stored
    tracemalloc.start()
    try:
        assert "binary" in refusal(path)
        assert tracemalloc.get_traced_memory()[1] < 2**26
    finally:
        tracemalloc.stop()


def test_a_text_above_the_limit_is_refused_with_its_size(tmp_path, monkeypatch):
    monkeypatch.setattr("preisach_jax.record.reading.MAX_TEXT_BYTES", 1000)
    path = write(tmp_path / "stage.csv", rows_of_text())
    message = refusal(path)
    assert f"{path.stat().st_size:,} bytes" in message
    assert "up to 1,000 are read" in message


def test_a_record_among_hundreds_of_columns_is_found_and_not_all_are_listed(tmp_path):
    rows = [[*row, *["7.5"] * 600] for row in rows_of_text()]
    rows[0][3:] = [f"channel_{k}" for k in range(600)]
    path = write(tmp_path / "wide.csv", rows)
    record = Record.load(path)
    np.testing.assert_array_equal(record.input, [float(row[1]) for row in rows[1:]])
    with pytest.raises(InputError, match=r"'volt'.*\(603 in all\)") as caught:
        Record.load(path, input="volt")
    assert len(str(caught.value)) < 1000


# --- columns --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"input": "U_v"}, ["stage.csv", "'U_v'", "did you mean u_V", "--input"]),
        ({"time": "time"}, ["stage.csv", "'time'", "t_s, u_V, z_um", "--time"]),
        ({"aux": ["load_N"]}, ["stage.csv", "'load_N'", "t_s, u_V, z_um", "--aux"]),
        ({"input": "z_um", "output": "z_um"}, ["stage.csv, column z_um", "2 roles"]),
        ({"units": {"u": "V"}}, ["stage.csv", "'u'", "correct the name"]),
        ({"units": {"time": "V"}}, ["stage.csv, column t_s", "no unit of time", "s, ms, us"]),
        ({"rate": 0.0}, ["rate is 0.0"]),
        ({"rate": float("nan")}, ["rate is nan"]),
        ({"rate": 10.0, "time": "t_s"}, ["not both"]),
        ({"initial_memory": "saturated"}, ["'saturated'", "low, high, demagnetised, free"]),
    ],
)
def test_wrong_columns_and_options(tmp_path, options, expected):
    path = write(tmp_path / "stage.csv", rows_of_text())
    with pytest.raises(InputError) as caught:
        Record.load(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert all(part in message for part in expected), message


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("a b c", ["guessed to be the time", "a, b, c", "--time", "--rate"]),
        ("t b c", ["guessed to be the input", "t, b, c", "--input"]),
        ("t u c", ["guessed to be the output", "t, u, c", "--output"]),
        ("t u x z", ["u, x could each be the input", "--input"]),
        ("t time u z", ["t, time could each be the time", "--time"]),
    ],
)
def test_names_that_leave_a_choice_are_refused(tmp_path, names, expected):
    names = names.split()
    rng = np.random.default_rng(3)
    data = np.cumsum(rng.uniform(0.1, 1, (K, len(names))), axis=0)
    path = write(tmp_path / "stage.csv", [names, *([f"{v:.6f}" for v in row] for row in data)])
    message = refusal(path)
    assert all(part in message for part in expected), message


@pytest.mark.parametrize(
    ("column", "begin", "cell", "expected"),
    [
        (1, 1, "0.5", "u_V.* constant .0.5"), (2, 1, "", "z_um.* empty"),
        (2, 1, "7", "z_um.* constant .7"),
        (2, 13, "", "column z_um: 12 measured samples are too few, at least 50"),
    ],
)  # fmt: skip
def test_a_column_that_says_nothing(tmp_path, column, begin, cell, expected):
    rows = rows_of_text()
    for row in rows[begin:]:
        row[column] = cell
    for options in ({}, COLUMNS):  # guessed, named
        assert re.search(expected, refusal(write(tmp_path / "stage.csv", rows), **options))


# --- other formats --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("+3.000000E-01,+4", "+x,+4", ["column field", "row 22", "'+x'"]),
        (",+4.000000E-07", "", ["column moment", "row 22", "no moment"]),
        ("NData          = 5", "NData          = 9", ["5 points", "NData = 9", "copy"]),
        ("HSat  ", "Hsomething  ", ["HSat = nothing", "CSV"]),
        ("First-order reversal curves", "Hysteresis loop", ["row 2", "'Hysteresis loop'"]),
    ],
)
def test_broken_micromag_files(tmp_path, old, new, expected):
    assert old in MICROMAG
    path = tmp_path / "two.forc"
    path.write_text(MICROMAG.replace(old, new, 1))
    message = refusal(path)
    assert all(part in message for part in expected), message


def test_containers_without_vectors_of_one_length(tmp_path):
    t, u, z = signals(K)
    path = tmp_path / "r.npz"
    np.savez(path, t=t, u=u, z=z[:-1])
    assert "column z: it has 59 values where others have 60" in refusal(path, output="z")
    np.savez(path, image=np.zeros((3, 3)))
    assert "no vectors (it holds image)" in refusal(path)
    np.savez(path, t=t, u=np.array([{}] * K), z=z)
    assert "not a readable NPZ file" in refusal(path)
    savemat(tmp_path / "r.mat", {"t": t, "u": u + 1j, "z": z})
    assert "column u, row 1" in refusal(tmp_path / "r.mat", input="u")


WHOLE = Record.from_arrays(*signals(K))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"input": [1.0, 2.0]}, r"bad, input: it has 2 values and time has 3"),
        ({"output": [1.0, np.inf, 2.0]}, r"bad, output\[1\]: the value is inf"),
        ({"time": [0.0, 2.0, 1.0]}, r"bad, time\[2\]: time runs backward, 1 after 2"),
        ({"input": [[1.0], [2.0], [3.0]]}, r"bad, input: an array of shape \(3, 1\)"),
        ({"input": ["a", "b", "c"]}, r"bad, input: .*; give an array of numbers"),
        ({"aux": {"load": [1.0, np.inf, 0.0]}}, r"bad, load\[1\]: the value is inf"),
        ({"units": {"volt": "V"}}, r"'volt', which is neither"),
        ({"units": {"time": "ms"}}, r"unit of time is 'ms'; give time in s"),
        ({"initial_memory": "off"}, r"initial_memory is 'off'"),
        ({"time": WHOLE, "input": None, "output": None}, "time is a whole Record: give .*d.input"),
        ({"output": WHOLE}, "bad, output is a whole Record"),
        ({"output": None}, "bad: there is no output; give time, input and output"),
        ({"input": [[0.0] * 3] * 2}, r"shape \(2, 3\).*several records a list of Records"),
    ],
)
def test_bad_arrays(change, expected):
    sound = {"time": [0.0, 1.0, 2.0], "input": [0.0, 1.0, 0.0], "output": [0.0, 1.0, 2.0]}
    with pytest.raises(InputError, match=expected):
        Record.from_arrays(**(sound | change), name="bad")
