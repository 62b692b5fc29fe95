"""The process of the command line: Ctrl-C, and what was compiled before."""

from __future__ import annotations

import os
import platform
import shutil
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""

MESSAGE = "preisach: interrupted\n"

_IMPORT = "<frozen importlib._bootstrap>"

SHORTLY_S = 0.01

PATIENCE_S = 0.7
"""Time for which an interruption waits for the interpreter, which compiled code may keep away."""

AGAIN = 0
"""Byte by which the thread that waits is asked for an interruption; no signal has the number 0."""

_noticed: list[int] = []
"""Signals that the interpreter has seen; no event, whose lock a signal in a signal never gets."""


def listen() -> None:
    """Take Ctrl-C for this process, from now on until `stop_listening`.

    Python's own way, an exception wherever the program is, fails at two places. Libraries that are
    just being imported answer it by tracebacks and errors of their own; so during an import, when
    nothing can be half written, the process ends at once. And a callback of the garbage collector
    (JAX has one) loses it; so it is raised once more behind the callback.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _interrupt)
        sys.unraisablehook = _raise_again
        _watch()


def _watch() -> None:
    """End the process where compiled code does not let the interpreter see an interruption.

    Files are written as a whole or not at all, so that nothing is torn by it.
    """
    seen, told = socket.socketpair()
    told.setblocking(False)
    signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)

    def wait() -> None:
        while number := seen.recv(1):
            if number[0] == AGAIN:
                time.sleep(SHORTLY_S)
                _signal_main_thread()
            elif number[0] == signal.SIGINT and not _noticed_soon():
                leave(INTERRUPTED)

    threading.Thread(target=wait, daemon=True, name="interruption").start()
    _kept.extend((seen, told))


_kept: list[socket.socket] = []


def _noticed_soon() -> bool:
    until = time.monotonic() + PATIENCE_S
    while not _noticed and time.monotonic() < until:
        time.sleep(SHORTLY_S)
    return bool(_noticed)


def leave(code: int) -> None:
    """End the process at once, without waiting for threads that compute."""
    if not _noticed:
        sys.stderr.write(MESSAGE)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def stop_listening() -> None:
    """Let a second Ctrl-C not disturb the end of the process that the first one brought."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _noticed.append(number)
    while frame is not None:
        if frame.f_code is _raise_again.__code__:  # where it would be lost once more
            _kept[1].send(bytes([AGAIN]))
            return
        if frame.f_code.co_filename == _IMPORT:
            sys.stdout.flush()
            sys.stderr.write(MESSAGE)
            sys.stderr.flush()
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt


def _raise_again(unraisable: sys.UnraisableHookArgs) -> None:
    if unraisable.exc_type is KeyboardInterrupt:
        # Not here: this is still inside the callback.
        _kept[1].send(bytes([AGAIN]))
    else:
        sys.__unraisablehook__(unraisable)


def _signal_main_thread() -> None:
    main = threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, signal.SIGINT)  # ends a wait, too, in which it may be
    else:
        signal.raise_signal(signal.SIGINT)


LEAST_FREE_BYTES = 2**26
"""Room for the programs of some diagnoses."""

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
    if before["jax_compilation_cache_dir"] or why_not_kept():
        yield False
        return
    first = not any(place.iterdir())
    for name, value in wanted.items():
        jax.config.update(name, value)
    try:
        with warnings.catch_warnings():
            # Where room runs out, a program is compiled again the next time: no reason for a
            # warning a program.
            warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation")
            yield first
    finally:
        for name, value in before.items():
            jax.config.update(name, value)


def why_not_kept() -> str:
    """Why nothing that is compiled can be kept; empty if it can, or is kept elsewhere."""
    import jax

    place = folder()
    if getattr(jax.config, "jax_compilation_cache_dir"):  # noqa: B009 - it is not typed
        return ""
    try:
        place.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(place).free
    except (OSError, RuntimeError):  # the latter where there is no home
        free = 0
    if free >= LEAST_FREE_BYTES and os.access(place, os.W_OK):
        return ""
    return (
        f"Compiled programs cannot be kept in {place} (no room, or not writable): every run "
        "compiles anew. Set XDG_CACHE_HOME to another folder."
    )
