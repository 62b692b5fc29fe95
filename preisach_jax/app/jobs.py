"""Long work beside a page: one job at a time, with progress, and cancelled at its next word."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from preisach_jax.fit import Progress

SPARSE_S = 0.15
"""Least time between two reports of progress."""


class JobCancelledError(Exception):
    """The job is not wanted any more."""


class Job:
    """Work in a thread of its own; what it reports is handed to the page's own thread.

    Arguments:
        work: called with a progress function; a cancelled job ends when it calls that.
        hand_over: runs a function without arguments in the page's thread.
        on_progress: called there with a text and a share done.
        on_done: called there with the result, unless the job was cancelled.
        on_error: called there with the exception, unless the job was cancelled.
    """

    def __init__(
        self,
        work: Callable[[Progress], Any],
        *,
        hand_over: Callable[[Callable[[], None]], object],
        on_progress: Progress,
        on_done: Callable[[Any], None],
        on_error: Callable[[Exception], None],
    ):
        self._work = work
        self._hand_over = hand_over
        self._on_progress = on_progress
        self._on_done = on_done
        self._on_error = on_error
        self._cancelled = threading.Event()
        self._last = 0.0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Let the result go; the work ends when it next reports."""
        self._cancelled.set()

    def _progress(self, text: str, done: float) -> None:
        if self._cancelled.is_set():
            raise JobCancelledError
        now = time.monotonic()
        if now - self._last >= SPARSE_S:
            self._last = now
            self._if_wanted(lambda: self._on_progress(text, done))

    def _run(self) -> None:
        try:
            result = self._work(self._progress)
        except JobCancelledError:
            return
        except Exception as error:
            failure = error
            self._if_wanted(lambda: self._on_error(failure))
        else:
            self._if_wanted(lambda: self._on_done(result))

    def _if_wanted(self, report: Callable[[], None]) -> None:
        # Asked when it runs: the job may be cancelled between now and then.
        def unless_cancelled() -> None:
            if not self._cancelled.is_set():
                report()

        self._hand_over(unless_cancelled)
