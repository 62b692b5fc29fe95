"""Damaged files and bombs: each is read, or refused soon, in little memory, by a plain message."""

import contextlib
import io
import json
import struct
import time
import tracemalloc
import zipfile
import zlib

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat
from strategies import columns, model_content
from test_record import MICROMAG

import preisach_jax as pj
from preisach_jax.files import plain_json
from preisach_jax.record.reading import read_table
from preisach_jax.record.units import split_unit

pd.read_csv(io.StringIO("0\n"))  # what is imported at first use is not the time of any file

ROWS = "".join(f"{k},{k % 7},{k % 5}\n" for k in range(60))
SECONDS = 2.0
MOST_BYTES = 100 * 2**20


def refused(path, content=None):
    """The one-line message with which a file is refused, soon and in little memory."""
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    read = pj.Model.load if path.suffix == ".json" else pj.Record.load
    tracemalloc.start()
    began = time.process_time()
    try:
        with pytest.raises(pj.InputError) as caught:
            read(path)
        spent, (_, most) = time.process_time() - began, tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    message = str(caught.value)
    assert message.startswith(str(path))
    assert len(message) < 2500
    assert spent < 5 * SECONDS  # watched by tracemalloc, which takes several times as long
    assert most < MOST_BYTES
    return message


# --- text ---


@pytest.mark.parametrize("sign", [" ", " in ", "("])
def test_looking_for_a_unit_takes_no_time_in_a_long_name(tmp_path, sign):
    path = tmp_path / "a.csv"
    assert "a column's name has" in refused(path, f"t,u{sign * 100_000}V,z\n{ROWS}")
    assert split_unit(f"u{sign * 100_000}V")[1] == ""


def test_a_field_of_a_megabyte_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    assert "characters" in refused(path, f't,u,"{"z" * 1_000_000}"\n{ROWS}')
    cell = f'0,1,"{"2" * 1_000_000}"\n'
    assert "more than 131,072 characters" in refused(path, f"t,u,z\n{cell}{ROWS}")


def test_quotation_marks_that_join_rows_lose_no_cell_unsaid(tmp_path):
    rows = "".join(f'{k},{k % 7},"a,{k % 5}\n' for k in range(60))
    assert "quotation mark" in refused(tmp_path / "a.csv", f"\t\n0,1,2b\n{rows}")


# --- archives of arrays ---


def arrays(**changed):
    file = io.BytesIO()
    np.savez(file, **columns() | changed)  # pyright: ignore[reportArgumentType]
    return file.getvalue()


def archive(method=zipfile.ZIP_DEFLATED, **members):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method, compresslevel=1) as made:
        for name, content in members.items():
            made.writestr(f"{name}.npy", content)
    return file.getvalue()


def npy(shape, descr="<f8", values=b""):
    header = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + values


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_damaged_compression_is_refused(tmp_path, method):
    content = bytearray(archive(method, t=npy("(60,)", values=np.arange(60.0).tobytes())))
    content[80:160] = bytes(range(80))
    assert "not a readable NPZ file" in refused(tmp_path / "a.npz", bytes(content))


def test_an_archive_that_unpacks_to_a_hundred_times_its_size_is_refused(tmp_path):
    content = archive(t=npy("(25000000,)", values=bytes(200_000_000)))
    assert len(content) < 1_000_000
    assert "2.5e+07 values" in refused(tmp_path / "a.npz", content)


@pytest.mark.parametrize("claimed", [4_000_000_000, 800])
def test_what_a_member_claims_is_not_allocated(tmp_path, claimed):
    """Half a thousand million numbers by its header, in a member of four gigabytes or of none."""
    content = archive(zipfile.ZIP_STORED, t=npy("(500000000,)", values=bytes(8)))
    at = content.index(b"PK\x01\x02")
    content = content[: at + 24] + struct.pack("<I", claimed) + content[at + 28 :]
    assert refused(tmp_path / "a.npz", content)


@pytest.mark.parametrize(
    ("shape", "descr"),
    [("(10000000000,)", "<U0"), ("(-1,)", "<f8"), ("(60,)", "|O"), ("(True,)", "<f8"),
     ("(" * 300, "<f8"), (f"{'-' * 5000}1", "<f8"), ("(60,)", "x"), ("(60.0,)", "<f8")],
)  # fmt: skip
def test_headers_that_cannot_be_are_refused(tmp_path, shape, descr):
    assert refused(tmp_path / "a.npz", archive(t=npy(shape, descr, bytes(480))))


@pytest.mark.parametrize(
    ("kind", "step_s"),
    [("M8[10s]", 10.0), ("m8[W]", 604_800.0), ("m8[ps]", 1e-12), ("m8[3h]", 10_800.0)],
)
def test_times_in_any_unit_are_read(tmp_path, kind, step_s):
    (tmp_path / "a.npz").write_bytes(arrays(t_s=np.arange(60).astype(kind)))
    record = pj.Record.load(tmp_path / "a.npz", time="t_s", input="u_V", output="z_um")
    np.testing.assert_allclose(record.time - record.time[0], step_s * np.arange(60), rtol=1e-14)


# --- MATLAB and Parquet ---


def matlab(compress=False, **arrays):
    file = io.BytesIO()
    savemat(file, arrays, do_compression=compress)
    return file.getvalue()


@pytest.mark.parametrize("word", [0, 10, 14, 15, 255, 2**32 - 1])
def test_no_word_of_a_variable_ends_the_process(tmp_path, word):
    """In SciPy, a kind of numbers that there is not reads memory that there is not."""
    content = matlab(t=np.arange(6.0), u={"a": np.arange(3.0)})
    for at in range(128, len(content) - 4, 4):
        path = tmp_path / "a.mat"
        path.write_bytes(content[:at] + struct.pack("<I", word) + content[at + 4 :])
        with contextlib.suppress(pj.InputError):
            read_table(path)


def test_a_matlab_file_that_unpacks_to_a_thousand_times_its_size_is_refused(tmp_path):
    content = matlab(compress=True, t=np.zeros(8_000_000))
    assert len(content) < 100_000
    assert "values or more" in refused(tmp_path / "a.mat", content)


def test_a_matlab_file_of_bombs_in_cells_is_refused(tmp_path):
    """A cell costs 8 bytes in the file, and one byte of it more where it is compressed."""
    inside = struct.pack("<IIII", 6, 8, 1, 0) + struct.pack("<IIII", 5, 8, 2**31 - 1, 2**31 - 1)
    inside += struct.pack("<II", 1, 0) + struct.pack("<II", 14, 0) * 1_000_000
    packed = zlib.compress(struct.pack("<II", 14, len(inside)) + inside)
    content = matlab(t=np.arange(60.0)) + struct.pack("<II", 15, len(packed)) + packed
    assert "values or more" in refused(tmp_path / "a.mat", content)


def test_a_parquet_file_that_repeats_a_number_without_end_is_refused(tmp_path):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "a.parquet"
    constant = pa.DictionaryArray.from_arrays(np.zeros(5_000_000, np.int8), pa.array([1.5]))
    parquet.write_table(pa.table({"t": constant}), path)
    assert path.stat().st_size < 100_000
    assert "5e+06 values" in refused(path)


# --- models ---


@pytest.fixture(scope="module")
def content():
    return plain_json(model_content())


@pytest.mark.parametrize(("opening", "depth"), [("[", 900), ('{"a":', 100_000)])
def test_json_that_is_nested_without_end_is_refused(tmp_path, content, opening, depth):
    text, nested = json.dumps(content), opening * depth
    closed = nested + {"[": "]" * depth, '{"a":': "1" + "}" * depth}[opening]
    for value in (nested, closed):
        changed = text.replace('"offset": 0.25', f'"offset": {value}')
        assert refused(tmp_path / "a.json", changed)


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (("levels",), 10**9, "expected as many numbers as 1000000000 levels have cells"),
        (("effects", 0, "name"), "magic", "magic"),
        (("low",), -1e308, "low is -1e+308: expected a finite number (up to 1e+100 in size)"),
        (("low",), 10.0 - 1e-15, "expected a number at least 5.33e-15 above low"),
        (("weights", 2), 1e308, "weights[2] is 1e+308: expected a finite number (up to 1e+100"),
        (("weights", 2), 10**400, "weights[2] is a number of more than 30 digits"),
        (("effects", 0, "name"), "\ud800", "effects[0].name is '\\ud800': expected a text"),
        (("effects", 4, "settings", "waves"), 10**9, "waves is 1000000000: expected a whole"),
        (("effects", 0, "parameters", "tau_s", "value"), 1e9, "tau_s.value is 1000000000.0"),
        (("identification", "initial_memory"), "warm", "initial_memory is 'warm': expected one"),
        (("identification", "history", 0, 1), -1.0, "each above the one before"),
    ],
    ids=lambda value: ".".join(map(str, value)) if isinstance(value, tuple) else None,
)  # fmt: skip
def test_a_key_of_a_model_is_refused_by_its_name(tmp_path, content, path, value, says):
    inside = damaged = json.loads(json.dumps(content))
    for key in path[:-1]:
        inside = inside[key]
    inside[path[-1]] = value
    assert says in refused(tmp_path / "a.json", json.dumps(damaged))


READABLE = {
    ".csv": lambda: f"t_s,u_V,z_um\n{ROWS}".encode(),
    ".forc": MICROMAG.encode,
    ".npz": arrays,
    ".mat": lambda: matlab(False, **columns()),
    ".parquet": pd.DataFrame(columns()).to_parquet,
    ".json": lambda: json.dumps(plain_json(model_content())).encode(),
}
WORDS = (
    b"nan", b"1e400", b"1,5", b"0x10", b'"', b"#", b"\t", b";", b"\x00", b"\xff\xfe", b"9" * 400,
    b"24:00:00", b"2024-02-30", b"1e99999999999", b"1+2j", b"NData = \xc2\xb2", b"[]", b"{}",
    b"null", b"PK\x03\x04",
)  # fmt: skip


PUT_IN = st.sampled_from(WORDS) | st.binary(max_size=9)
DAMAGE = st.tuples(st.floats(0, 1), st.integers(0, 40), PUT_IN)


@pytest.mark.parametrize("ending", READABLE)
@given(damage=st.lists(DAMAGE, min_size=1, max_size=3))
def test_damaged_files_are_read_or_refused(tmp_path_factory, ending, damage):
    content = READABLE[ending]()
    for place, left_out, put_in in damage:
        at = round(place * len(content))
        content = content[:at] + put_in + content[at + left_out :]
    path = tmp_path_factory.mktemp("damaged") / f"file{ending}"
    path.write_bytes(content)
    with contextlib.suppress(pj.InputError):
        (pj.Model.load if ending == ".json" else read_table)(path)
