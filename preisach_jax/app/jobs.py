"""Long work beside a page: one job at a time, with progress, and cancelled at its next word."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn
from markupsafe import Markup
from panel.io.state import set_curdoc

from preisach_jax.app import panels
from preisach_jax.app.layout import at_once, in_passing
from preisach_jax.fit import Progress

SPARSE_S = 0.15
"""Least time between two reports of progress."""


class JobCancelledError(Exception):
    """The job is not wanted any more."""


class Job:
    """Work in a thread of its own; what it reports is handed to the page's own thread."""

    def __init__(
        self,
        work: Callable[[Progress], Any],
        *,
        hand_over: Callable[[Callable[[], None]], object],
        tell: Callable[[Callable[[], None]], object] | None = None,
        on_progress: Progress,
        on_done: Callable[[Any], None],
        on_error: Callable[[Exception], None],
    ):
        self._work = work
        self._hand_over = hand_over
        self._tell = tell or hand_over
        self._on_progress = on_progress
        self._on_done = on_done
        self._on_error = on_error
        self._cancelled = threading.Event()
        self._last = 0.0

    def start(self) -> None:
        """Begin; what is reported may come at once."""
        threading.Thread(target=self._run, daemon=True).start()

    def cancel(self) -> None:
        """Let the result go; the work ends when it next reports."""
        self._cancelled.set()

    def _progress(self, text: str, done: float) -> None:
        if self._cancelled.is_set():
            raise JobCancelledError
        now = time.monotonic()
        if now - self._last >= SPARSE_S:
            self._last = now
            self._if_wanted(lambda: self._on_progress(text, done), self._tell)

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

    def _if_wanted(
        self,
        report: Callable[[], None],
        hand_over: Callable[[Callable[[], None]], object] | None = None,
    ) -> None:
        # Asked when it runs: the job may be cancelled between now and then.
        def unless_cancelled() -> None:
            if not self._cancelled.is_set():
                report()

        (hand_over or self._hand_over)(unless_cancelled)


class Working:
    """What a page needs to work on one thing at a time, and to say how far it is."""

    def __init__(self, doing: Any, message: Any):
        self._document = pn.state.curdoc
        self._doing = doing
        self._message = message
        self._job: Job | None = None

    def _refresh(self) -> None:
        """Show what can be done now."""

    def _failed(self) -> None:
        """Called when work has failed."""

    def _let_go(self) -> None:
        """Called when work is given up."""

    def _start(
        self,
        what: str,
        work: Callable[[Progress], Any],
        done: Callable[[Any], None],
        refused: Callable[[Exception], None] | None = None,
    ) -> None:
        """Begin work in place of what is going on; `done` gets its result in the page's thread.

        Where the work fails, `refused` is called in place of the message at the head of the page.
        """
        self._stop_job()

        def finished(result: Any) -> None:
            self._job = None
            self._say_progress("", 0.0)
            done(result)
            self._refresh()

        def failed(error: Exception) -> None:
            self._stop_job()
            if refused is None:
                self._failed()
                self._say(panels.failure(error))
            else:
                refused(error)
            self._refresh()

        self._say_progress(what, 0.0)
        job = self._job = Job(
            partial(_in_tab, self._document, work), hand_over=self._hand_over, tell=self._tell,
            on_progress=self._say_progress, on_done=finished, on_error=failed,
        )  # fmt: skip
        self._refresh()
        job.start()

    def _stop_job(self) -> None:
        if self._job is not None:
            self._job.cancel()
            self._job = None
            self._say_progress("", 0.0)
        self._let_go()

    def _hand_over(self, function: Callable[[], None]) -> None:
        self._next(function, at_once)

    def _tell(self, function: Callable[[], None]) -> None:
        self._next(function, in_passing)

    def _next(self, function: Callable[[], None], how: Callable[..., None]) -> None:
        document = self._document
        if document is None:
            function()  # without a server there is no other thread to hand it to
        elif document.session_context is not None:  # else the tab has been closed meanwhile
            document.add_next_tick_callback(partial(_in_tab, document, how, function))

    def _say_progress(self, text: str, done: float) -> None:
        self._doing.object = panels.progress(text, done)

    def _say(self, text: Markup | str) -> None:
        self._message.object = str(Markup.escape(text))


def _in_tab(document: Any, call: Callable[..., Any], *arguments: Any) -> Any:
    # The document that Bokeh takes for the present one is one for all threads: in a job's own it is
    # that of whatever tab is served just then, whose style sheets must not get here.
    with set_curdoc(document):
        return call(*arguments)
