"""Damage that knows the format: cells and lines of a text, members of an archive, a JSON tree.

Each function takes content and a generator of random numbers, and gives other content; what it
cannot take apart it leaves to damage of single bytes.
"""

from __future__ import annotations

import copy
import io
import json
import random
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

CELLS = (
    "", " ", "nan", "inf", "-inf", "1e400", "-1e308", "1e308", "1e-320", "0", "-0", "1,5", "1.5",
    "1.234,5", "1_000", "0x10", "1e", "+", "NA", "NULL", "None", "True", "٣", "１２", "½", "−1",
    '"', '""', '"a', 'a"b', "'", "#", "%", "\\", "\t", "  ", ";", "|", "\x00", "\x1a", "\x0b",
    "\x0c", "\x85", "\u2028", "\ufeff", "é", "t_s", "u_V", "z_um", "column 2", "t [ms]", "t [",
    "u in V",
    "/", "[um]", "-", "()", "1700000000000000000", "9" * 30, "9" * 400, "99999999999", "1e8",
    "-1e9", "12:00", "24:00:00", "12:60", "23:59:60.5", "2024-02-30 12:00:00",
    "0000-01-01 00:00:00", "9999-12-31T23:59:59+99:99", "01/02/2024 10:00", "2024-03-01",
    "1e99999999999", "1.0d5", "1+2j", "(1)", "$1", "=1+1", "1e+", "infinity", "12:00:00.١",
    "MicroMag", "HSat = nan", "HSat = 1e400", "Averaging time = -1", "PauseSat = inf",
    "Elapsed time = nan", "HCal = inf", "NData = ²", "NData = 5", "First-order reversal curves",
)  # fmt: skip


def damaged_text(content: bytes, rng: random.Random) -> bytes:
    """Lines, cells, delimiters, quotation marks and the encoding of a text changed."""
    encoding = "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8"
    text = content.decode(encoding, errors="replace")
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        text = rng.choice(_OF_TEXTS)(text, rng)[:900_000]
    encoding = rng.choice(("utf-8",) * 12 + ("utf-8-sig", "utf-16", "utf-16-le", "cp1252"))
    return text.encode(encoding, errors="replace")


def _line(text: str, rng: random.Random) -> tuple[list[str], int]:
    lines = text.split("\n")
    return lines, rng.choice((0, 1, rng.randrange(len(lines)))) % len(lines)


def _cell(text: str, rng: random.Random) -> str:
    lines, i = _line(text, rng)
    sign = rng.choice(",;\t| ")
    cells = lines[i].split(sign)
    k = rng.randrange(len(cells))
    cells[k] = rng.choice((rng.choice(CELLS), cells[k] + rng.choice(CELLS)))
    lines[i] = sign.join(cells)
    return "\n".join(lines)


def _column(text: str, rng: random.Random) -> str:
    sign, new = rng.choice(",;\t| "), rng.choice(CELLS)
    k, from_line = rng.randrange(4), rng.choice((0, 1, 1, 2, 30))
    lines = [line.split(sign) for line in text.split("\n")]
    for cells in lines[from_line:]:
        if len(cells) > k:
            cells[k] = new
    return "\n".join(sign.join(cells) for cells in lines)


def _lines(text: str, rng: random.Random) -> str:
    lines, i = _line(text, rng)
    j = rng.randrange(len(lines))
    kind = rng.randrange(6)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    elif kind == 2:
        lines[i], lines[j] = lines[j], lines[i]
    elif kind == 3:
        lines.insert(i, rng.choice(CELLS))
    elif kind == 4:
        del lines[min(i, j) : max(i, j)]
    else:
        lines[i] = lines[i][: rng.randrange(len(lines[i]) + 1)]
    return "\n".join(lines)


def _signs(text: str, rng: random.Random) -> str:
    return text.replace(rng.choice(",;\t|.: \n=-"), rng.choice((*",;\t|.: \n\"'", "", ",,", "  ")))


def _long(text: str, rng: random.Random) -> str:
    lines, i = _line(text, rng)
    k = rng.randrange(len(lines[i]) + 1)
    sign = rng.choice(
        (" ", "_", "\t", ",", "a", "9", '"', "(", "[", ";", "\n", "e", " in ", "/ ", "#,")
    )
    longer = sign * rng.choice((3,) * 9 + (50,) * 9 + (3_000, 3_000, 100_000, 400_000))
    lines[i] = lines[i][:k] + longer + lines[i][k:]
    return "\n".join(lines)


_OF_TEXTS = (*(_cell,) * 6, _column, _column, *(_lines,) * 4, _signs, _signs, _long)


def damaged_npz(content: bytes, rng: random.Random) -> bytes:
    """An archive with a member's header, values, name or compression changed."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except Exception:
        return _bytes(content, rng)
    if not members:
        return _bytes(content, rng)
    name = rng.choice(list(members))
    kind = rng.randrange(6)
    if kind == 0:
        members[name] = _npy_with_header(rng) + members[name][rng.choice((128, 10)) :]
    elif kind == 1:
        members[name] = _bytes(members[name], rng)
    elif kind == 2:
        members[rng.choice(("t_s.npy", "a/b", "x" * 3000, "../t.npy", "é.npy", "u_V"))] = (
            members.pop(name)
        )
    elif kind == 3:
        del members[name]
    elif kind == 4:
        file = io.BytesIO()
        np.lib.format.write_array(file, _array(rng), allow_pickle=True)
        members[name] = file.getvalue()
    file = io.BytesIO()
    method = rng.choice(
        (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2)
    )
    with zipfile.ZipFile(file, "w", method) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for member, inside in members.items():
            archive.writestr(member, inside)
    return file.getvalue() if rng.random() < 0.8 else _bytes(file.getvalue(), rng)


_TYPES = (
    "<f8 >f8 <f4 <f2 <f16 |b1 <i8 <u8 |i1 <c16 <M8[ns] <M8[Y] <m8[D] <M8 |O |S0 |S5 <U0 <U7 |V0 "
    "|V9 <M8[10s] =f8 x f8,f8 <f8,<i4"
).split()


def _npy_with_header(rng: random.Random) -> bytes:
    shape = rng.choice(
        ("(60,)", "()", "(0,)", "(60, 0)", "(10000000000,)", "(-1,)", "(2**70,)", "(True,)", "60",
         "(1,)*40", "(60.0,)", "(100000000000000000000,)", "(30, 2)", "(1, 60)", "None",
         "(" * 300, "-" * 5000 + "1")
    )  # fmt: skip
    descr = repr(rng.choice(_TYPES))
    if rng.random() < 0.2:
        descr = rng.choice(("[('a', '<f8')]", "[]", "3", "('<f8', (2,))", "('O', 5)", "None"))
    order = rng.choice(("True", "False", "1", "None"))
    header = f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n".encode()
    version = rng.choice((b"\x01\x00", b"\x01\x00", b"\x02\x00", b"\x03\x00", b"\x09\x00"))
    size = len(header) if rng.random() < 0.9 else rng.randrange(70_000)
    packed = struct.pack("<H" if version == b"\x01\x00" else "<I", size % 65536)
    return b"\x93NUMPY" + version + packed + header


def _array(rng: random.Random) -> Any:
    size = rng.choice((0, 1, 2, 60, 60, 60, 60))
    values: Any = rng.choice(
        (np.arange(size), np.linspace(-1, 1, size), np.full(size, np.nan), np.full(size, 2**62),
         np.full(size, 1e308), np.full(size, -(2**63)), np.arange(size) > 30, np.zeros((size, 0)),
         np.arange(size).astype("M8[s]"), np.full(size, "NaT", "M8[ns]"), np.array(["1.5"] * size),
         np.array([None] * size), np.arange(size).astype("m8[D]"), np.array(3.0),
         np.full(size, 2**63, np.uint64), 1j * np.arange(size), np.array([b"\xff"] * size),
         np.full(size, 2**62).astype("M8[Y]"), np.arange(size).astype("M8"),
         np.zeros(size, [("a", "f8")]), np.zeros((1,) * 30), np.arange(size).astype("f2"),
         np.arange(size).astype(np.longdouble), np.array([{}, [], "a", 1.0] * 15, dtype=object))
    )  # fmt: skip
    return values


def damaged_mat(content: bytes, rng: random.Random) -> bytes:
    """A MATLAB file with the content of one of its elements, or the tag of one, changed."""
    if len(content) < 136 or rng.random() < 0.2:
        return _bytes(content, rng)
    elements, at = [], 128
    while at + 8 <= len(content):
        kind, size = struct.unpack_from("<II", content, at)
        elements.append((kind, content[at + 8 : at + 8 + size]))
        at += 8 + size
    if not elements:
        return _bytes(content, rng)
    i = rng.randrange(len(elements))
    kind, inside = elements[i]
    try:
        plain = (
            zlib.decompress(inside)
            if kind == 15
            else struct.pack("<II", kind, len(inside)) + inside
        )
    except zlib.error:
        return _bytes(content, rng)
    for _ in range(rng.choice((1, 1, 2, 5))):
        if rng.random() < 0.6 and len(plain) >= 16:
            at = 8 * rng.randrange(min(len(plain) // 8, 12)) + rng.choice((0, 4))
            word = rng.choice(
                (0, 1, 2, 5, 6, 7, 9, 14, 15, 17, 18, 60, 255, 2**28, 2**31 - 1, 2**32 - 1)
            )
            plain = plain[:at] + struct.pack("<I", word) + plain[at + 4 :]
        else:
            plain = _bytes(plain, rng)
    if rng.random() < 0.5:
        packed = zlib.compress(plain)
        made = struct.pack("<II", 15, len(packed)) + packed
    else:
        made = plain
    others = [struct.pack("<II", kind, len(inside)) + inside for kind, inside in elements]
    others[i] = made
    if rng.random() < 0.1:
        rng.shuffle(others)
    return content[:128] + b"".join(others)


def damaged_parquet(content: bytes, rng: random.Random) -> bytes:
    """Bytes of the footer or of the pages changed, or a new table of columns of any types."""
    import pyarrow as pa
    from pyarrow import parquet

    kind = rng.randrange(4)
    if kind == 0:
        try:
            table = pa.table(
                {rng.choice(("t_s", "u_V", "z_um", "a", "")) + str(k) * (k > 2): column
                 for k in range(4) if (column := _array(rng)).ndim == 1 and column.size == 60}
            )  # fmt: skip
            file = io.BytesIO()
            parquet.write_table(table, file)
            return file.getvalue()
        except Exception:
            return _bytes(content, rng)
    if kind == 1 or len(content) < 16:
        return _bytes(content, rng)
    (size,) = struct.unpack("<I", content[-8:-4])
    start = max(4, len(content) - 8 - size)
    if kind == 2:
        return content[:start] + _bytes(content[start:-8], rng)[:size] + content[-8:]
    return _bytes(content[:start], rng)[:start].ljust(start, b"\0") + content[start:]


def _bytes(content: bytes, rng: random.Random) -> bytes:
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(data) + 1)
        kind = rng.randrange(5)
        if kind == 0:
            data[at : at + 1] = bytes([rng.randrange(256)])
        elif kind == 1:
            data[at : at + rng.randrange(1, 40)] = b""
        elif kind == 2:
            data[at:at] = rng.choice((b"\0", b"\xff" * 8, b"PK\x03\x04", rng.randbytes(9)))
        elif kind == 3:
            data = data[:at]
        elif data:
            data[at % len(data)] ^= 1 << rng.randrange(8)
    return bytes(data)


DEEP = 3_000


def _leaves() -> tuple[Any, ...]:
    deep: Any = 1
    for _ in range(400):
        deep = [deep]
    return (
        None, True, False, 0, 1, -1, 2, 0.5, -0.0, 1e308, -1e308, 5e-324,
        float("nan"), float("inf"), float("-inf"), 10**9, 2**63, 10**400, -(10**20), "", "a",
        "creep", "aux:", "aux:COL", "drift", "relay", "NaN", "1", "x" * 5000, "\ud800",
        "line\nbreak", [], [[]], {}, {"": {}}, [None],
        [1.0] * 6, [1.0] * 5000, list(range(6)), [1e308] * 6, [True] * 6, ["1"] * 6, [10**400] * 6,
        [[0.0, 1.0]] * 2, [[0.0], [1.0, 2.0]], {"value": 1.0}, deep,
    )  # fmt: skip


LEAVES = _leaves()
"""What is put in the place of a value of a JSON tree."""


def damaged_tree(tree: Any, rng: random.Random) -> Any:
    """A JSON tree in which values are replaced, and keys and items are lost, doubled or renamed."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        places: list[tuple[Any, Any]] = []

        def walk(node: Any, depth: int = 0, places=places) -> None:
            if depth > 20:
                return
            if isinstance(node, dict | list):
                for key in node if isinstance(node, dict) else range(min(len(node), 8)):
                    places.append((node, key))
                    walk(node[key], depth + 1)

        walk(tree)
        if not places:
            return rng.choice(LEAVES)
        node, key = rng.choice(places)
        kind = rng.randrange(8)
        if kind == 0:
            del node[key]
        elif kind == 1 and isinstance(node, dict):
            node[rng.choice(("", "name", "x", "c_1", "tau_s", str(key) + "2"))] = node.pop(key)
        elif kind == 2 and isinstance(node, list):
            node.insert(key, copy.deepcopy(node[key]))
        elif kind == 3:
            other, where = rng.choice(places)
            node[key] = copy.deepcopy(other[where])
        else:
            node[key] = copy.deepcopy(rng.choice(LEAVES))
    return tree


def damaged_json(content: bytes, rng: random.Random) -> bytes:
    """A JSON file with its tree, or its text, changed."""
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError):
        return _bytes(content, rng)
    kind = rng.randrange(20)
    if kind == 0:
        return _bytes(content, rng)
    if kind == 1:
        text = content.decode("utf-8", errors="replace")
        deep = rng.choice(("[", '{"a":')) * rng.choice((100, DEEP, 100_000))
        old = rng.choice(("0.25", '"relay"', "null", "[", ","))
        return text.replace(old, rng.choice((deep, "9" * 6000, "1e999", "NaN", "")), 1).encode()
    try:
        return json.dumps(damaged_tree(tree, rng)).encode()
    except (ValueError, RecursionError):
        return content


DAMAGE: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "delimited": damaged_text,
    "micromag": damaged_text,
    "npz": damaged_npz,
    "mat": damaged_mat,
    "parquet": damaged_parquet,
    "model": damaged_json,
}
"""How a file of each reader is damaged."""
