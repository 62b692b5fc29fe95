"""Vectors from files of MATLAB, version 5 to 7.

SciPy reads them too, but a damaged one can end the whole process in it, and a small one can unpack
to more than there is memory.  A record needs little of the format: arrays of numbers, texts, cells,
and structures of them.  Here each size is compared with what there is before it is believed.

Format: MAT-File Format, The MathWorks (the part on level 5).
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from preisach_jax.errors import ContentError

_NUMBERS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CLASSES = {
    6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8",
}  # fmt: skip
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCTURE, _TEXT = 1, 2, 4
_IS_COMPLEX = 0x800


class TooMuchError(ContentError):
    """A file unpacks to more values than it may; `args[0]` is how many at least."""


@dataclass
class _Budget:
    """How many bytes and values may still be unpacked."""

    bytes: int
    values: float

    def take(self, values: int) -> None:
        self.values -= values
        if self.values < 0:
            raise TooMuchError(values)


def matlab_arrays(content: bytes, most_values: float) -> dict[str, Any]:
    """The variables of a file: arrays, texts, lists of cells, and structures as dicts of them."""
    order = ">" if content[126:128] == b"MI" else "<"
    if content[126:128] not in (b"MI", b"IM"):
        raise ContentError("its header does not say in which order the bytes stand")
    budget = _Budget(int(8 * most_values), most_values)
    found: dict[str, Any] = {}
    at = 128
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        inside = memoryview(content)[at + 8 : at + 8 + size]
        if len(inside) < size:
            raise ContentError("it breaks off")
        at += 8 + size
        if kind == _COMPRESSED:
            kind, inside, _ = _element(_inflated(inside, budget), 0, order)
        if kind == _MATRIX:
            name, value = _matrix(inside, order, budget)
            if value is not None:
                found[name] = value
    return found


def _inflated(packed: memoryview, budget: _Budget) -> memoryview:
    decompress = zlib.decompressobj()
    try:
        plain = decompress.decompress(packed, budget.bytes + 1)
    except zlib.error as error:
        raise ContentError(f"a variable cannot be decompressed: {error}") from None
    if len(plain) > budget.bytes:
        raise TooMuchError(budget.bytes // 8)
    budget.bytes -= len(plain)
    return memoryview(plain)


def _element(view: memoryview, at: int, order: str) -> tuple[int, memoryview, int]:
    """Kind and data of the element that begins at a byte, and where the next one begins."""
    if at + 8 > len(view):
        raise ContentError("a variable breaks off")
    (word,) = struct.unpack_from(f"{order}I", view, at)
    if word >> 16:  # up to four bytes stand in the tag
        kind, size, start, after = word & 0xFFFF, word >> 16, at + 4, at + 8
    else:
        kind, start = word, at + 8
        (size,) = struct.unpack_from(f"{order}I", view, at + 4)
        after = start + size + -size % 8
    data = view[start : start + size]
    if len(data) < size or (word >> 16 and size > 4):
        raise ContentError("a variable breaks off")
    return kind, data, after


def _elements(view: memoryview, at: int, order: str) -> Iterator[tuple[int, memoryview]]:
    while True:
        kind, data, at = _element(view, at, order)
        yield kind, data


def _numbers(kind: int, data: memoryview, order: str) -> np.ndarray:
    if kind not in _NUMBERS:
        raise ContentError(f"numbers of an unknown kind, {kind}")
    dtype = np.dtype(order + _NUMBERS[kind])
    if len(data) % dtype.itemsize:
        raise ContentError("a variable breaks off")
    return np.frombuffer(data, dtype)


def _matrix(view: memoryview, order: str, budget: _Budget) -> tuple[str, Any]:
    """Name and value of a variable or a field; None for what is no array, text or structure."""
    if not len(view):
        return "", None
    parts = _elements(view, 0, order)
    flags = int(_numbers(*next(parts), order)[:1].sum())
    shape = [int(size) for size in _numbers(*next(parts), order)]
    name = bytes(next(parts)[1]).decode("utf-8", errors="replace")
    if min(shape, default=0) < 0 or len(shape) > 32:
        raise ContentError(f"{name[:60]} has the shape {shape[:32]}")
    kind, count = flags & 0xFF, math.prod(shape)
    budget.take(count)
    if kind in _CLASSES:
        values = _values(parts, kind, order, count)
        if flags & _IS_COMPLEX:
            values = values.astype(complex)
            values.imag = _values(parts, kind, order, count)
        return name, np.squeeze(values.reshape(shape, order="F"))
    if kind == _TEXT:
        return name, _text(*next(parts), shape, order)
    if kind == _CELL:
        cells = [_matrix(_child(next(parts)), order, budget)[1] for _ in range(count)]
        return name, np.array([cell if isinstance(cell, str) else None for cell in cells], object)
    if kind == _STRUCTURE and count == 1:
        return name, _structure(parts, order, budget)
    return name, None


def _values(
    parts: Iterator[tuple[int, memoryview]], kind: int, order: str, count: int
) -> np.ndarray:
    """The numbers of an array, which may be stored in fewer bytes than they have in MATLAB."""
    values = _numbers(*next(parts), order)
    if values.size != count:
        raise ContentError(f"a variable has {values.size} values where its shape has {count}")
    with np.errstate(all="ignore"):
        return values.astype(_CLASSES[kind])


def _child(element: tuple[int, memoryview]) -> memoryview:
    kind, data = element
    if kind != _MATRIX:
        raise ContentError(f"a field of the kind {kind} where a variable should be")
    return data


def _structure(
    parts: Iterator[tuple[int, memoryview]], order: str, budget: _Budget
) -> dict[str, Any]:
    width = int(_numbers(*next(parts), order)[:1].sum())
    names = bytes(next(parts)[1])
    if width < 1:
        raise ContentError("a structure's names have no length")
    fields = [names[i : i + width].split(b"\0")[0] for i in range(0, len(names), width)]
    found = {
        field.decode("latin-1"): _matrix(_child(next(parts)), order, budget)[1] for field in fields
    }
    return {field: value for field, value in found.items() if value is not None}


def _text(kind: int, data: memoryview, shape: list[int], order: str) -> str | np.ndarray:
    """A text, or the rows of a matrix of characters as an array of texts."""
    if kind not in _ENCODINGS:
        raise ContentError(f"characters of an unknown kind, {kind}")
    encoding = _ENCODINGS[kind]
    if encoding in {"utf-16", "utf-32"}:
        encoding += "-be" if order == ">" else "-le"
    signs = bytes(data).decode(encoding, errors="replace")
    rows = shape[0] if shape else 0
    if rows <= 1:
        return signs
    if len(signs) != math.prod(shape):
        raise ContentError("a matrix of characters breaks off")
    return np.array([signs[i::rows].rstrip() for i in range(rows)], dtype=object)
