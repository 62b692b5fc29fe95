"""Binary files of others are read in a child: what ends it is one line, and tables come back."""

import os
import signal

import numpy as np
import pytest

from preisach_jax.errors import InputError
from preisach_jax.record import apart, reading
from preisach_jax.record.readers import HDF5, PARQUET

T = np.arange(60) / 50


def test_a_table_comes_back_as_it_was_read(tmp_path):
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = {
        "t_ns": 1_700_000_000_000_000_000 + np.arange(60) * 1000, "u": np.sin(T),
        "on": T > 0.5, "text": pa.array(["a;\u00e9", None, "1,5"] * 20),
        "day": np.full(60, np.datetime64("2024-01-01", "D")), "list": pa.array([[1]] * 60),
    }  # fmt: skip
    field = pa.field("u", pa.float64(), metadata={"unit": "V"})
    table = pa.table(columns)
    parquet.write_table(table.set_column(1, field, table["u"]), tmp_path / "a.parquet")
    (here,) = apart.read_here(PARQUET, tmp_path / "a.parquet", "a")
    (there,) = apart.read_apart(PARQUET, tmp_path / "a.parquet", "a")
    for kind in ("columns", "exact"):
        one, other = getattr(here, kind), getattr(there, kind)
        assert list(one) == list(other)
        for name, cells in one.items():
            assert cells.dtype == other[name].dtype
            assert [*map(str, cells)] == [*map(str, other[name])], name
    np.testing.assert_array_equal(here.rows, there.rows)
    for name in ("source", "named", "decimal", "units", "left_aside", "roles", "notes"):
        assert getattr(here, name) == getattr(there, name), name
    assert there.units == {"u": "V", "day": "s"}
    (tmp_path / "b.parquet").write_bytes(b"PAR1" * 9)
    with pytest.raises(InputError, match=r"^b: not a readable Parquet file"):
        apart.read_apart(PARQUET, tmp_path / "b.parquet", "b")


def test_a_megabyte_of_parquet_is_read_within_the_limit(tmp_path):
    # Arrow sets 1 GiB of addresses aside, which was all that the limit left a file of this size.
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = np.random.default_rng(0).normal(size=(4, 30_000))
    parquet.write_table(pa.table(dict(zip("tuzf", columns, strict=True))), tmp_path / "a.parquet")
    (table,) = apart.read_apart(PARQUET, tmp_path / "a.parquet", "a")
    np.testing.assert_array_equal(table.columns["z"], columns[2])


@pytest.mark.skipif(not hasattr(signal, "SIGABRT") or os.name == "nt", reason="no limits here")
def test_a_workbook_that_asks_for_all_memory_ends_a_child_alone(tmp_path, monkeypatch):
    openpyxl = pytest.importorskip("openpyxl")
    pytest.importorskip("python_calamine")
    book = openpyxl.Workbook()
    book.active["A1"] = book.active["XFD1048576"] = 1.0
    book.save(tmp_path / "a.xlsx")
    monkeypatch.setattr(reading, "read_apart", apart.read_apart)
    for path in (tmp_path / "a.xlsx", f"{tmp_path / 'a.xlsx'}#Sheet"):
        with pytest.raises(
            InputError, match=r"a.xlsx: reading it as Excel.* more memory"
        ) as caught:
            reading.read_table(path)
        assert "\n" not in str(caught.value)


def test_texts_that_unpack_to_gigabytes_are_refused_by_their_size(tmp_path):
    h5py, pa = pytest.importorskip("h5py"), pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("t", (2000,), "S1000000", chunks=(1,), compression="gzip")
    texts = pa.array(["x" * 9000] * 5000)
    parquet.write_table(
        pa.table({"t": texts}), tmp_path / "a.parquet", compression="zstd", use_dictionary=False
    )
    for reader, name in ((HDF5, "a.h5"), (PARQUET, "a.parquet")):
        with pytest.raises(InputError, match=r"bytes unpack to .* values or more"):
            apart.read_here(reader, tmp_path / name, name)


@pytest.mark.parametrize(
    ("status", "said", "told"),
    [
        (-9, "", "SIGKILL (a crash, or more"), (-7, "", "SIGBUS (a crash"),
        (1, "Traceback\n  x\nKeyError: 'a'\n", "an error (KeyError: 'a')"), (3, "", "nothing said"),
        (-getattr(signal, "SIGXCPU", 24), "", "the limit of its processor time"),
    ],
)  # fmt: skip
@pytest.mark.skipif(os.name == "nt", reason="no signals")
def test_what_ended_a_child_is_told(tmp_path, monkeypatch, status, said, told):
    (tmp_path / "a").write_bytes(b"1")
    done = apart.subprocess.CompletedProcess((), status, b"", said.encode())
    monkeypatch.setattr(apart.subprocess, "run", lambda *_, **__: done)
    with pytest.raises(InputError) as caught:
        apart.read_apart(HDF5, tmp_path / "a", "a")
    message = str(caught.value)
    assert message.startswith("a: reading it as HDF5 was ended by ")
    assert told in message
    assert message.endswith("; save its columns as CSV, or with numpy.savez")
