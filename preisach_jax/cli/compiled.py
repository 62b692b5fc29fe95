"""Compiled code that is kept between runs, so that a machine compiles it once."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

MOST_BYTES = 2**29
"""Size of the folder beyond which what was used longest ago is deleted."""


def folder() -> Path:
    """Where compiled code is kept: in the user's cache, one folder a machine."""
    # Code is compiled for one processor; a home may be shared by machines of several kinds.
    return _user_cache() / "preisach_jax" / f"compiled-{platform.node() or 'machine'}"


def _user_cache() -> Path:
    if asked := os.environ.get("XDG_CACHE_HOME"):
        return Path(asked)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path.home() / ".cache"


@contextmanager
def kept_between_runs() -> Generator[bool]:
    """Keep what JAX compiles inside, unless it is told already where, or nothing can be written."""
    import jax

    place = folder()
    wanted = {
        "jax_compilation_cache_dir": str(place),
        "jax_compilation_cache_max_size": MOST_BYTES,
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }
    before = {name: getattr(jax.config, name) for name in wanted}
    if before["jax_compilation_cache_dir"] or not _made(place):
        yield False
        return
    first = not any(place.iterdir())
    for name, value in wanted.items():
        jax.config.update(name, value)
    try:
        yield first
    finally:
        for name, value in before.items():
            jax.config.update(name, value)


def _made(place: Path) -> bool:
    try:
        place.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return False
    return os.access(place, os.W_OK)
