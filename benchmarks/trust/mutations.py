"""Damage that knows the format: cells and lines of a text, members of an archive, a JSON tree.

Each function takes content of its format and a source of random numbers, and gives other content.
"""

from __future__ import annotations

import copy
import io
import json
import random
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

CELLS = (
    "", " ", "nan", "inf", "1e400", "1e308", "-0", "1,5", "1.234,5", "1_000", "0x10", "1e", "NA",
    "True", "٣", "１２", "½", "−1", '"', '"a', 'a"b', "#", "%", "\\", "\t", ";", "|", "\x00",
    "\x85", "\u2028", "\ufeff", "t_s", "u_V", "column 2", "t [", "u in V", "9" * 30, "9" * 400,
    "1700000000000000000", "-1e9", "24:00:00", "23:59:60.5", "2024-02-30 12:00:00",
    "9999-12-31T23:59:59+99:99", "01/02/2024 10:00", "1e99999999999", "1.0d5", "1+2j", "=1+1",
    "12:00:00.١", "MicroMag", "HSat = nan", "PauseSat = inf", "NData = ²", "NData = 5",
)  # fmt: skip
LONG = (" ", "_", ",", "a", "9", '"', "(", ";", "\n", " in ", "#,")


def damaged_text(content: bytes, rng: random.Random) -> bytes:
    """Cells, lines, delimiters and the encoding of a text changed."""
    encoding = "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8"
    lines = content.decode(encoding, errors="replace").split("\n")
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        i, j = rng.choice((0, 1, rng.randrange(len(lines)))) % len(lines), rng.randrange(len(lines))
        kind, sign = rng.randrange(9), rng.choice(",;\t| ")
        if kind < 3:
            rows = lines[i : i + 1] if kind else lines[i:]  # a cell, or a column from there on
            k, new = rng.randrange(max(1, rows[0].count(sign) + 1)), rng.choice(CELLS)
            for n, row in enumerate(rows, i):
                cells = row.split(sign)
                cells[k : k + 1] = [new]
                lines[n] = sign.join(cells)
        elif kind == 3:
            lines.insert(j, lines[i])
        elif kind == 4:
            lines[i], lines[j] = lines[j], lines[i]
        elif kind == 5:
            del lines[min(i, j) + 1 : max(i, j)]
        elif kind == 6:
            lines[i] = lines[i][: rng.randrange(len(lines[i]) + 1)]
        elif kind == 7:
            old, new = rng.choice(",;\t|.: =-"), rng.choice((*",;\t|.: \"'", "", ",,"))
            lines = [line.replace(old, new) for line in lines]
        else:
            lines[i] += rng.choice(LONG) * rng.choice((3, 3, 50, 50, 3_000, 100_000))
    encoding = rng.choice(("utf-8",) * 6 + ("utf-8-sig", "utf-16", "utf-16-le", "cp1252"))
    return "\n".join(lines)[:900_000].encode(encoding, errors="replace")


def damaged_npz(content: bytes, rng: random.Random) -> bytes:
    """An archive with bytes, the name or the values of a member changed."""
    kind = rng.randrange(5)
    if kind == 0:
        return damaged_bytes(content, rng)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = rng.choice(list(members))
    if kind == 1:
        del members[name]
    elif kind == 2:
        new = rng.choice(("t_s.npy", "a/b", "x" * 3000, "../t.npy", "é.npy", "u_V"))
        members[new] = members.pop(name)
    elif kind == 3:
        members[name] = damaged_bytes(members[name], rng)
    else:
        values: Any = rng.choice(
            (np.arange(2), np.full(60, 1e308), np.zeros((60, 0)), np.array(["1.5"] * 60),
             np.full(60, "NaT", "M8[ns]"), np.array([None] * 60), 1j * np.arange(60),
             np.full(60, 2**62).astype("M8[Y]"), np.zeros(60, [("a", "f8")]), np.arange(60.0))
        )  # fmt: skip
        file = io.BytesIO()
        np.save(file, values)
        members[name] = file.getvalue()
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", rng.choice((0, 8, 12, 14))) as archive:  # each compression
        for member, inside in members.items():
            archive.writestr(member, inside)
    return file.getvalue()


def damaged_mat(content: bytes, rng: random.Random) -> bytes:
    """A MATLAB file with a word of its tags changed, in compressed elements too."""
    if rng.random() < 0.2:
        return damaged_bytes(content, rng)
    kind, size = struct.unpack_from("<II", content, 128)
    first, rest = content[128 : 136 + size], content[136 + size :]
    plain = zlib.decompress(first[8:]) if kind == 15 else first
    at = 4 * rng.randrange(min(len(plain) // 4, 24))
    word = rng.choice((0, 1, 5, 6, 9, 14, 15, 17, 60, 255, 2**28, 2**31 - 1, 2**32 - 1))
    plain = plain[:at] + struct.pack("<I", word) + plain[at + 4 :]
    if kind == 15:
        packed = zlib.compress(plain)
        plain = struct.pack("<II", 15, len(packed)) + packed
    return content[:128] + plain + rest


def damaged_bytes(content: bytes, rng: random.Random) -> bytes:
    """Bytes put in, left out or changed, or the end cut off."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(data) + 1)
        kind = rng.randrange(4)
        if kind == 0:
            data[at : at + rng.randrange(1, 40)] = b""
        elif kind == 1:
            data[at:at] = rng.choice((b"\0", b"\xff" * 8, b"PK\x03\x04", rng.randbytes(9)))
        elif kind == 2:
            data = data[:at]
        elif data:
            data[at % len(data)] ^= 1 << rng.randrange(8)
    return bytes(data)


LEAVES = (
    None, True, 0, -1, 0.5, 1e308, -1e308, 5e-324, float("nan"), float("inf"), 10**9, 10**400, "",
    "creep", "aux:", "NaN", "x" * 5000, "\ud800", "line\nbreak", [], [[]], {}, {"": {}}, [None],
    [1.0] * 6, [1e308] * 6, [True] * 6, ["1"] * 6, [[0.0], [1.0, 2.0]], {"value": 1.0},
)  # fmt: skip
"""What is put in the place of a value of a JSON tree."""


def damaged_json(content: bytes, rng: random.Random) -> bytes:
    """A JSON file whose values are replaced, and keys and items lost, doubled or renamed."""
    tree = json.loads(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        places: list[tuple[Any, Any]] = []
        nodes: list[Any] = [tree]
        while nodes:
            node = nodes.pop()
            if isinstance(node, dict | list):
                keys = list(node) if isinstance(node, dict) else range(min(len(node), 8))
                places += [(node, key) for key in keys]
                nodes += [node[key] for key in keys]
        if not places:
            break
        node, key = rng.choice(places)
        kind = rng.randrange(6)
        if kind == 0:
            del node[key]
        elif kind == 1 and isinstance(node, dict):
            node[rng.choice(("", "name", "c_1", "tau_s", f"{key}2"))] = node.pop(key)
        elif kind == 2 and isinstance(node, list):
            node.insert(key, copy.deepcopy(node[key]))
        elif kind == 3:
            other, where = rng.choice(places)
            node[key] = copy.deepcopy(other[where])
        else:
            node[key] = copy.deepcopy(rng.choice(LEAVES))
    return json.dumps(tree).encode()


DAMAGE: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "delimited": damaged_text,
    "micromag": damaged_text,
    "npz": damaged_npz,
    "mat": damaged_mat,
    "parquet": damaged_bytes,
    "model": damaged_json,
}
"""How a file of each reader is damaged."""
