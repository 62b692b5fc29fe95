"""Files that are packed by gzip or into a ZIP archive: one file comes out, and is read."""

from __future__ import annotations

import gzip
import zipfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import IO, cast

from preisach_jax.errors import InputError
from preisach_jax.record.readers.base import not_readable
from preisach_jax.record.table import shortened

GZIP = b"\x1f\x8b"
ZIP = (b"PK\x03\x04", b"PK\x05\x06")
"""Beginnings of archives; the second one is that of an empty one."""

MOST_BYTES = 2**26
"""Bytes that any packed file may unpack to, however small it is."""

MOST_BYTES_A_BYTE = 200
"""Bytes that each byte of a greater one may unpack to."""

MOST_UNPACKED = 2**30
"""Bytes to which nothing may unpack."""

_BLOCK = 2**20
_OTHERS = ("__MACOSX/", ".DS_Store", "Thumbs.db", "desktop.ini")
_ABOUT = (".md", ".pdf", ".png", ".jpg", ".jpeg", ".svg", ".html", ".docx", ".rtf", ".log", ".py")
_BOOKS = ("[Content_Types].xml", "content.xml")


def packed_kind(path: Path, head: bytes) -> str | None:
    """`"gzip"` or `"zip"` where a file is packed, and is no workbook and no archive of arrays."""
    if head.startswith(GZIP):
        return "gzip"
    if not head.startswith(ZIP) or path.suffix.lower() == ".npz":
        return None
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except Exception:  # a broken workbook is to be told as such
        is_book = path.suffix.lower() in {".xlsx", ".xlsm", ".xlsb", ".ods"}
        return None if is_book else "zip"
    return None if set(_BOOKS) & set(names) or _is_npz(names) else "zip"


def is_npz(path: Path, head: bytes) -> bool:
    """Whether a file is an archive of arrays of NumPy, whatever its ending."""
    if not head.startswith(ZIP):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return _is_npz(archive.namelist())
    except Exception:  # broken: its ending tells
        return False


def _is_npz(names: Sequence[str]) -> bool:
    return bool(names) and all(name.endswith(".npy") for name in names)


def unpack(path: Path, kind: str, folder: Path, source: str) -> tuple[Path, str]:
    """Unpack the one file that a packed file holds, and say which texts lie beside it."""
    remedy = "pack it again, or give the file as it was before"
    try:
        if kind == "gzip":
            inside = path.name.removesuffix(".gz").removesuffix(".gzip") or "record"
            target = folder / f"record{Path(inside).suffix}"
            with gzip.open(path) as stream, target.open("wb") as file:
                _copy(cast(IO[bytes], stream), file, path.stat().st_size, source)
            return target, ""
        with zipfile.ZipFile(path) as archive:
            member, others = _only_file(archive, source)
            target = folder / f"record{Path(member.filename).suffix}"
            with archive.open(member) as stream, target.open("wb") as file:
                _copy(stream, file, path.stat().st_size, source)
            left = f"{source}: {member.filename} was read, and {shortened(others)} left aside"
            return target, left if others else ""
    except InputError:
        raise
    except Exception as error:  # the decompressors raise many kinds on a broken file
        raise not_readable("gzip" if kind == "gzip" else "ZIP", error, source, remedy) from None


def _only_file(archive: zipfile.ZipFile, source: str) -> tuple[zipfile.ZipInfo, list[str]]:
    """The one file that may be a record, and the names of the others."""
    members = [
        each
        for each in archive.infolist()
        if not each.is_dir() and not any(other in each.filename for other in _OTHERS)
    ]
    aside = [each.filename for each in members if _is_about(each.filename)]
    if len(members) - len(aside) == 1:
        members = [each for each in members if each.filename not in aside]
    else:
        aside = []
    if len(members) != 1:
        names = [each.filename for each in members]
        held = f"{len(members)} files ({shortened(names[:5])}{', ...' if names[5:] else ''})"
        raise InputError(
            f"{source}: the ZIP archive holds {held if members else 'no file'}; unpack it and give "
            "one of them" + ("" if members else ", or pack the record again")
        )
    if members[0].flag_bits & 1:
        raise InputError(
            f"{source}: the ZIP archive is protected by a password; unpack it and give the file"
        )
    return members[0], aside


def _is_about(name: str) -> bool:
    """Whether a file tells of a record, and holds none, by its name."""
    path = PurePosixPath(name.lower())
    return path.suffix in _ABOUT or path.stem.startswith(
        ("readme", "license", "licence", "liesmich")
    )


def _most(size: int) -> int:
    return min(max(MOST_BYTES, MOST_BYTES_A_BYTE * size), MOST_UNPACKED)


def _copy(stream: IO[bytes], file: IO[bytes], size: int, source: str) -> None:
    """Copy block by block, and stop where it becomes far too much."""
    total = 0
    while block := stream.read(_BLOCK):
        total += len(block)
        if total > _most(size):
            raise _bomb(size, total, source)
        file.write(block)


def check_members(
    archive: zipfile.ZipFile, members: Sequence[zipfile.ZipInfo], size: int, source: str
) -> None:
    """Refuse an archive that unpacks to far too much, by unpacking it block by block.

    What an archive states of its sizes is not believed.
    """
    total = 0
    for member in members:
        with archive.open(member) as stream:
            while block := stream.read(_BLOCK):
                total += len(block)
                if total > _most(size):
                    raise _bomb(size, total, source)


def _bomb(size: int, total: int, source: str) -> InputError:
    return InputError(
        f"{source}: its {size:,} bytes unpack to {total:,} or more, and no record is compressed so "
        "far; if they are right, unpack it and give the file, or thin the record"
    )
