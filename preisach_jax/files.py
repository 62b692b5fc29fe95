"""Writing results so that a folder never holds half of one."""

from __future__ import annotations

import errno
import glob
import io
import json
import os
import re
import secrets
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, cast

import numpy as np

from preisach_jax.errors import ContentError, InputError


def plain_json(value: Any) -> Any:
    """A value with NumPy's numbers made Python's, and what JSON lacks (NaN, infinity) made null."""
    if isinstance(value, Mapping):
        table = cast(Mapping[Any, Any], value)
        return {str(key): plain_json(inner) for key, inner in table.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain_json(inner) for inner in cast(Iterable[Any], value)]
    if isinstance(value, np.generic):
        return plain_json(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def json_bytes(content: Any) -> bytes:
    """A JSON file's bytes; there are no NaN in it.

    A file's name may hold bytes that are no text: question marks stand for them.
    """
    text = json.dumps(plain_json(content), indent=1, ensure_ascii=False, allow_nan=False)
    return (text + "\n").encode(errors="replace")


def file_name(thing: str) -> str:
    """A name for a file, from that of a thing, such as a column, that may hold any characters."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", thing)


# How each kind of file begins that a command writes. Columns of CSV and keys of JSON are relied
# upon to the letter: those of a kind are their own mark, or `marked_csv` is.
_OURS = re.compile(
    rb"""
    t,z_pred,z_low,z_high\n | t,u,z_expected,z_low,z_high,reachable\n
    | t_s,[^\n]*\n0e0,
    | \{\s*"format":[ ] (?: "preisach_jax | \d+,\s*"rows":)
    | \{\s*"sha256":[ ]"\w+",\s*"settings":[ ]\{\s*"does":
    | \{\s*"verdict":[ ]"\w+",\s*"sentence": | \{\s*"comparisons":[ ]\[\s*\{\s*"name":
    | \{\s*"record":[ ]\{\s*"name":[ ][^\n]*\s*"sha256":
    | \{\s*"effects":[ ]\[[^]]*\],\s*"parameters":
    | \{\s*"figure":[ ]\d+,\s*"title":
    | \x89PNG.{,80}Software\0preisach_jax | <\?xml.{,900}<dc:title>preisach_jax</dc:title>
    | <!DOCTYPE[ ]html>.{,300}content="preisach_jax"
    | /\*[ ](?:A[ ]Preisach[ ]model[ ]of[ ]hysteresis|Self[ ]test[ ]of[ ]preisach_model)
    | \#[ ]A[ ]Preisach[ ]model[ ]in[ ]C\n
    | \#[ ]make[ ]{11}builds[ ]the[ ]library[ ]and[ ]the[ ]self
    """,
    re.DOTALL | re.VERBOSE,
)
_HEAD_BYTES = 4096

PARQUET_MARK = b"written by preisach_jax"
"""Key in the metadata of a Parquet file, which stands at its end."""


def marked_csv(content: bytes) -> bytes:
    """A table whose first number is zero, with that spelled as nobody else does: a mark."""
    return re.sub(rb"\n0(\.0)?,", b"\n0e0,", content, count=1)


def is_ours(path: Path) -> bool:
    """Whether a command wrote a file, as it begins; one that is empty holds nothing to be lost."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
            if head.startswith((b"%PDF", b"PAR1")):  # which say at their ends who wrote them
                file.seek(-min(_HEAD_BYTES, path.stat().st_size), os.SEEK_END)
                end = file.read()
                return b"/Producer (preisach_jax)" in end or PARQUET_MARK in end
            if head.startswith(b"PK"):
                with zipfile.ZipFile(file) as fmu, fmu.open("modelDescription.xml") as text:
                    return b'generationTool="preisach_jax' in text.read(16 * _HEAD_BYTES)
    except (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error):
        return False
    return not head or _OURS.match(head) is not None


def check_output(path: Path, read: Iterable[Path] = (), *, force: bool = False) -> None:
    """Make sure that nothing of the user's goes when a file is written.

    Arguments:
        force: whether it may replace what no command wrote.
    """
    for other in read:
        book = Path(str(other).rpartition("#")[0] or other)
        if any(is_same(path, one) for one in (other, book)):
            raise InputError(
                f"{path}: this file is read, and would be lost; choose another place for results"
            )
    _check_plain(path)
    if not force and path.exists() and not is_ours(path):
        raise InputError(
            f"{path}: preisach_jax did not write this file, and a result would replace it; choose "
            "another place, or --force"
        )


def is_same(path: Path, other: Path) -> bool:
    """Whether two paths lead to one place, also where links lead nowhere or in a loop."""
    # Names that differ in case may be one file.
    if os.path.realpath(path) == os.path.realpath(other):
        return True
    return path.exists() and other.exists() and path.samefile(other)


def _check_plain(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"{path} is a folder; choose a file to be written")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise InputError(f"{path} is a link or a device; choose a file to be written")


def check_regular(path: Path, remedy: str) -> None:
    """Refuse what would be read without end or waited for: a pipe, a device, a folder."""
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: this is a folder, a device or a pipe: {remedy}")


def check_folder(
    folder: Path, read: Iterable[Path] = (), written: Iterable[str] = (), *, force: bool = False
) -> None:
    """Make sure before the work that results can be written into a folder afterwards.

    Arguments:
        force: whether files may replace what no command wrote.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: this is a file; give a folder for the results")
    if folder.is_symlink() and not folder.exists():
        raise InputError(f"{folder}: this link leads nowhere; give a folder for the results")
    place = folder
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{folder}: {place} is a file, not a folder; choose another folder")
    if not _is_writable(place):
        raise InputError(f"{folder}: {place} cannot be written to; choose another folder")
    read = list(read)
    for name in written:
        check_output(folder / name, read, force=force)


def _is_writable(folder: Path) -> bool:
    """Whether a file can be made in a folder; rights do not say it of /proc."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def check_file(path: Path, *read: Path, force: bool = False) -> None:
    """Make sure before the work that a file can be written afterwards.

    Arguments:
        force: whether it may replace what no command wrote.
    """
    if path.is_dir():
        raise InputError(f"{path}: this is a folder; give the name of a file")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}; make it, or choose another")
    if not _is_writable(path.parent):
        raise InputError(f"{path}: {path.parent} cannot be written to; choose another place")
    check_output(path, read, force=force)


def write_files(contents: Mapping[Path, bytes]) -> list[Path]:
    """Write files; those that are there stay whole until all new ones are on the disk.

    Each file is at every moment, also after a crash of the program or of the machine, the old one
    or the new one. What such a crash leaves of unfinished files is hidden, and goes when the same
    file is written next.
    """
    for path in contents:
        _check_plain(path)
    unfinished: dict[Path, Path] = {}
    path = None
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            _remove_abandoned(path)
            unfinished[path] = path.with_name(
                f".{path.name}.{secrets.token_hex(4)}.{os.getpid()}{_PART}"
            )
            _write_durably(unfinished[path], content, path)
        for path, part in unfinished.items():
            os.replace(part, path)
        for folder in {path.parent for path in contents}:
            _make_names_durable(folder)
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "choose another place")
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); {remedy}"
        ) from error
    finally:
        for part in unfinished.values():
            with suppress(OSError):  # the folder itself may be gone
                part.unlink(missing_ok=True)
    return list(contents)


_PART = ".part"

_REMEDIES = {
    errno.ENOSPC: "make room, or choose another place",
    errno.EDQUOT: "make room, or choose another place",
    errno.EFBIG: "this process may not write files of this size: raise its limit (ulimit -f)",
    errno.EIO: "the disk fails: choose another place",
    errno.ENAMETOOLONG: "choose a shorter name",
}


def _write_durably(part: Path, content: bytes, old: Path) -> None:
    """Write a new file with an old one's mode, and come back when the disk has it."""
    # Nothing that stands there, such as a link that someone has put, is opened.
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
    flags |= getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(part, flags, 0o666), "wb") as file:
        if old.exists():
            part.chmod(stat.S_IMODE(old.stat().st_mode))
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _make_names_durable(folder: Path) -> None:
    """Let the disk have the names in a folder; not all systems can, and files are whole anyway."""
    with suppress(OSError):
        opened = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)


def _remove_abandoned(path: Path) -> None:
    """Remove what processes that were killed have left of a file that they were writing."""
    if os.name == "nt":  # which has no harmless way to ask whether a process lives
        return
    named = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.(\d+){re.escape(_PART)}")
    for part in path.parent.glob(f".{glob.escape(path.name)}.*{_PART}"):
        number = named.fullmatch(part.name)
        if number is None or _lives(int(number[1])):
            continue
        with suppress(OSError):  # somebody else removes it at this moment
            found = part.lstat()
            if stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid():
                part.unlink()


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True  # it is someone else's
    return True


def write_arrays(path: Path, about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays and what there is to say about them as one `.npz` file."""
    file = io.BytesIO()
    named: dict[str, Any] = {"about": np.asarray(json.dumps(about)), **arrays}
    np.savez(file, **named)
    write_files({path: file.getvalue()})


@contextmanager
def read_arrays(
    path: Path, known: int, thing: str, remedy: str
) -> Generator[tuple[dict[str, Any], Any]]:
    """Open a file that `write_arrays` wrote.

    Whatever goes wrong in the block that reads from it is taken for damage of the file.
    """
    check_regular(path, remedy)
    try:
        if path.is_file() and not zipfile.is_zipfile(path):
            raise ContentError("it is no archive of arrays")
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            about = json.loads(str(stored["about"]))
            if about["format"] != known:
                raise InputError(
                    f"{path} has the format {about['format']}, and this version reads {known}: "
                    "install the version that wrote it"
                )
            yield about, stored
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path} does not exist: {remedy}") from None
    # Of a damaged file, zipfile may say that it is encrypted or compressed in an unknown way.
    except (
        OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, zipfile.BadZipFile,
    ) as error:  # fmt: skip
        raise InputError(f"{path} cannot be read as {thing} ({error}): {remedy}") from error
