"""Memory of the process: what is freed goes back to the operating system."""

from __future__ import annotations

import ctypes
import sys

LARGE_BYTES = 2**22
"""Size from which on an array gets pages of its own, which go back when it is freed."""

M_MMAP_THRESHOLD = -3  # of <malloc.h>


def give_back_what_is_freed() -> bool:
    """Let the C library give large arrays back to the system as soon as they are freed.

    glibc keeps freed blocks of up to 32 MiB once it has seen one, in an arena for each thread
    (mallopt(3), M_MMAP_THRESHOLD): of a diagnosis that is a third of its peak.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        return bool(ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE_BYTES))
    except (OSError, AttributeError):  # another C library
        return False
