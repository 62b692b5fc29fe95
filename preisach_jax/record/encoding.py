"""From the bytes of a file to its text, and what files are that are no text."""

from __future__ import annotations

import codecs

from preisach_jax.errors import InputError

HEAD_BYTES = 65536
"""Bytes at the beginning of a file by which it is known whether it is text."""

_KINDS = {
    b"\x89PNG": "it is a PNG picture",
    b"\xff\xd8\xff": "it is a JPEG picture",
    b"%PDF": "it is a PDF document",
    b"\x7fELF": "it is a program",
    b"\x1f\x8b": "it is compressed by gzip twice: unpack it",
    b"PK\x03\x04": "it is a ZIP archive within another: unpack it",
}
# Signs that no text holds: tabs, line and page ends, the end mark of DOS and escapes are left out.
_CONTROLS = bytes(set(range(32)) - set(b"\t\n\v\f\r\x1a\x1b"))
_SHARE = 0.01  # of such signs that a text may hold, as some loggers write a few


def check_text(head: bytes, source: str) -> None:
    """Refuse a file that is not text, by its beginning."""
    if not is_text(head):
        kind = next((kind for magic, kind in _KINDS.items() if head.startswith(magic)), "")
        is_kind = f" ({kind})" if kind else ""
        raise InputError(
            f"{source}: the file is binary, not text{is_kind}; give a CSV, workbook, NPZ, MAT, "
            "HDF5, TDMS, Parquet, Feather or MicroMag (.forc) file"
        )


def is_text(head: bytes) -> bool:
    """Whether a file is text, by its beginning of up to `HEAD_BYTES` bytes."""
    if _encoding(head) is not None:
        return True
    controls = sum(head.count(bytes([code])) for code in _CONTROLS)
    is_known = head.startswith(tuple(_KINDS))
    return not (is_known or b"\0" in head or controls > _SHARE * len(head))


def decode(content: bytes) -> tuple[str, str]:
    """The text of a file.

    Returns:
        The text with `\\n` as line end and without byte-order mark, and what was assumed of its
        encoding, `""` if nothing.
    """
    assumed = ""
    encoding = _encoding(content[:HEAD_BYTES])
    if encoding is not None:
        text = content.decode(encoding, errors="replace").removeprefix("\ufeff")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            assumed = "it is not in UTF-8 and was read as Windows-1252"
            text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n"), assumed


def _encoding(head: bytes) -> str | None:
    """UTF-16 by its mark, or by every second byte that is zero; None for anything else."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    even, odd = head[::2], head[1::2]
    if len(head) >= 8:
        for name, zeros, others in (("utf-16-le", odd, even), ("utf-16-be", even, odd)):
            if zeros.count(0) > 0.8 * len(zeros) and 0 not in others:
                return name
    return None
