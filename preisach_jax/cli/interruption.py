"""Ctrl-C, so that it ends a command at any moment, by one line and without a traceback.

Python runs its handler of a signal between two instructions, so not while compiled code computes;
no library ends that, a second thread with a wake-up file descriptor does.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from types import FrameType

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""

MESSAGE = "preisach: interrupted\n"

_IMPORT = "<frozen importlib._bootstrap>"

PATIENCE_S = 0.7
"""Time for which an interruption waits for the interpreter, which compiled code may keep away."""

_noticed = threading.Event()


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
            if number[0] == signal.SIGINT and not _noticed.wait(PATIENCE_S):
                leave(INTERRUPTED)

    threading.Thread(target=wait, daemon=True, name="interruption").start()
    _kept.extend((seen, told))


_kept: list[socket.socket] = []


def leave(code: int) -> None:
    """End the process at once, without waiting for threads that compute."""
    if not _noticed.is_set():
        sys.stderr.write(MESSAGE)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def stop_listening() -> None:
    """Let a second Ctrl-C not disturb the end of the process that the first one brought."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interrupt(number: int, frame: FrameType | None) -> None:
    del number
    _noticed.set()
    while frame is not None:
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
        again = threading.Timer(0.01, _signal_main_thread)
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(unraisable)


def _signal_main_thread() -> None:
    main = threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, signal.SIGINT)  # ends a wait, too, in which it may be
    else:
        signal.raise_signal(signal.SIGINT)
