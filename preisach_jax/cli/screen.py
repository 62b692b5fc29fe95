"""What the command line shows: texts, tables and JSON on stdout, progress on stderr."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from preisach_jax.escape import printable, printable_lines
from preisach_jax.present import (
    budget_rows,
    error_table,
    finding_parameters,
    form_lines,
    headline,
    loss_table,
    record_lines,
    run_table,
)

if TYPE_CHECKING:
    import numpy as np
    from rich.console import Console

    from preisach_jax.diagnosis.result import Diagnosis
    from preisach_jax.fit import Progress
    from preisach_jax.record.core import Record

_WIDTH = 110  # of tables that no terminal limits
_MARGIN = 12  # of a picture, for its ends
_SPARSE_S = 2.0  # between two lines of progress that nobody may be reading


@dataclass(frozen=True)
class _Manner:
    """How the running command was asked to show things."""

    as_json: bool = False
    quiet: bool = False


_MANNER: ContextVar[_Manner] = ContextVar("manner", default=_Manner())  # noqa: B039 - it is frozen


@contextmanager
def manner(*, as_json: bool, quiet: bool) -> Generator[None]:
    """Let what is shown inside follow `--json` and `--quiet`."""
    before = _MANNER.set(_Manner(as_json, quiet))
    try:
        yield
    finally:
        _MANNER.reset(before)


def _console(file: Any = None) -> Console:
    """A console for stdout or a file; names from files are never taken for markup."""
    from rich.console import Console

    terminal = (file or sys.stdout).isatty()
    return Console(
        file=file, highlight=False, markup=False, emoji=False, width=None if terminal else _WIDTH
    )


def say(text: str = "") -> None:
    """Print a text of a result; lines are broken for a terminal only."""
    if not (_MANNER.get().as_json or _MANNER.get().quiet):
        _print(text)


def note(text: str) -> None:
    """Print what is of use beside a result: to stderr where stdout belongs to JSON."""
    if not _MANNER.get().quiet:
        _print(text, sys.stderr if _MANNER.get().as_json else None)


def answer(text: str) -> None:
    """Print the one line that `--quiet` leaves of a result; else the line is not shown."""
    if _MANNER.get().quiet and not _MANNER.get().as_json:
        sys.stdout.write(f"{printable(' '.join(text.split()))}\n")


def show_json(content: Any) -> None:
    """Print the result of a command as JSON, if that was asked for."""
    if _MANNER.get().as_json:
        from preisach_jax.files import json_bytes

        content = json_bytes(content)
        buffer = getattr(sys.stdout, "buffer", None)
        if buffer is None:  # a notebook's
            sys.stdout.write(content.decode())
            return
        # JSON is UTF-8 whatever the terminal takes.
        sys.stdout.flush()
        buffer.write(content)
        buffer.flush()


def written(files: Iterable[Path], **about: Any) -> dict[str, Any]:
    """What `--json` shows of a command that writes files: their paths, and what is in them."""
    return {"files": [str(path) for path in files], **about}


def _print(text: str, file: Any = None) -> None:
    screen = _console(file)
    screen.print(printable_lines(text), soft_wrap=not screen.is_terminal)


def table(headers: Sequence[str], rows: Iterable[Sequence[str]], numbers: bool = True) -> None:
    """Print a table, all but the first column to the right if they are numbers."""
    if _MANNER.get().as_json or _MANNER.get().quiet:
        return
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    drawn = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for position, header in enumerate(headers):
        drawn.add_column(header, justify="right" if numbers and position else "left")
    for row in rows:
        drawn.add_row(*map(printable_lines, row))
    _console().print(drawn)


def picture(
    time: np.ndarray, values: np.ndarray, lines: int, limits: tuple[float, float] | None = None
) -> None:
    """Print a signal over time as a picture of Braille signs, its ends beside it."""
    if _MANNER.get().as_json or _MANNER.get().quiet:
        return
    import numpy as np

    from preisach_jax.look.drawing import braille

    there = values[np.isfinite(values)]
    low, high = limits or (float(there.min()), float(there.max()))
    width = _picture_width()
    ends = (f"{time[0]:.4g} s", f"{time[-1]:.4g} s")
    _framed(braille(time, values, width, lines, limits), (f"{low:.4g}", f"{high:.4g}"), ends, width)


def loop_picture(
    x: np.ndarray, y: np.ndarray, names: tuple[str, str], lines: int, signs: int
) -> None:
    """Print output against input as a picture of Braille signs, its ends beside it."""
    if _MANNER.get().as_json or _MANNER.get().quiet:
        return
    import numpy as np

    from preisach_jax.look.drawing import braille_curve

    there = np.isfinite(x) & np.isfinite(y)
    x, y = x[there], y[there]
    width = min(_picture_width(), signs)
    (left, right), (low, high) = ([f"{side():.3g}" for side in (v.min, v.max)] for v in (x, y))
    say(f"{' ' * (_MARGIN - 1)}{names[1]}")
    _framed(braille_curve(x, y, width, lines), (low, high), (left, f"{names[0]} {right}"), width)


def _picture_width() -> int:
    return min(_console().width, _WIDTH) - _MARGIN


def _framed(rows: Sequence[str], sides: tuple[str, str], ends: tuple[str, str], width: int) -> None:
    screen = _console()
    for k, row in enumerate(rows):
        label = sides[1] if k == 0 else sides[0] if k == len(rows) - 1 else ""
        screen.print(f"{label:>{_MARGIN - 2}} {row}", soft_wrap=True)
    first, last = ends
    screen.print(" " * (_MARGIN - 1) + first + last.rjust(width - len(first)), soft_wrap=True)


class TimeLeft:
    """How long a work will take yet, from how much of it is done.

    Parts of a work take longer than others, so an estimate is blended with the one before, less
    the time that has passed; what is shown is rounded so coarsely that it does not flicker.
    """

    _BEGIN_S, _BEGIN_SHARE = 4.0, 0.04  # before, an estimate means nothing
    _MEMORY = 5.0  # it follows what happens within this part of the time passed

    def __init__(self):
        self._first: tuple[float, float] | None = None  # share that was done, and when
        self._left = self._last = math.nan

    def __call__(self, done: float, now: float) -> str:
        """What to show, `""` while nothing is known.

        Arguments:
            now: time in s, on a clock that never goes back.
        """
        if self._first is None:  # work that goes on may begin with much of it done
            self._first = (done, now)
        share, passed = done - self._first[0], now - self._first[1]
        if passed < self._BEGIN_S or share < self._BEGIN_SHARE or done >= 1:
            return ""
        fresh = max(1.0 - done, 0.0) * passed / share
        if math.isnan(self._left):
            self._left = fresh
        else:
            since = now - self._last
            weight = 1.0 - math.exp(-self._MEMORY * since / passed)
            expected = max(self._left - since, 0.0)
            self._left = expected + weight * (fresh - expected)
        self._last = now
        return f"{_coarse(self._left)} left"


# Share of a diagnosis that is done, by its search, and share of its time that has passed then. How
# many rounds a search needs is known at its end only: some stop at 0.38, others go on beyond 0.8.
_SEARCHED = (0.0, 0.14, 0.2, 0.3, 0.38, 0.6, 0.75, 0.8, 0.85, 0.95, 0.98, 1.0)
_PASSED = (0.0, 0.3, 0.42, 0.45, 0.5, 0.5, 0.6, 0.7, 0.88, 0.9, 0.95, 1.0)


def of_a_diagnosis(show: Progress) -> Progress:
    """Progress of a diagnosis in shares of its time, as it was in measured records."""
    import numpy as np

    return lambda text, done: show(text, float(np.interp(done, _SEARCHED, _PASSED)))


def _coarse(seconds: float) -> str:
    if seconds < 5:
        return "a few seconds"
    if seconds < 95:
        return f"about {10 * math.ceil(seconds / 10)} s"
    if seconds < 95 * 60:
        return f"about {math.ceil(seconds / 60)} min"
    return f"about {math.ceil(seconds / 3600)} h"


@contextmanager
def progress() -> Generator[Progress]:
    """A bar on stderr if that is a terminal, else a line every now and then; nothing if quiet."""
    if _MANNER.get().quiet:
        yield lambda text, done: None
    elif sys.stderr.isatty():
        with _bar() as show:
            yield show
    else:
        yield _Lines()


@contextmanager
def _bar() -> Generator[Progress]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        SpinnerColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
    )
    from rich.text import Text

    class Left(ProgressColumn):
        """The time left."""

        max_refresh = 0.5  # s
        estimate = TimeLeft()

        def render(self, task: Task) -> Text:
            return Text(self.estimate(task.completed, time.monotonic()))

    columns = (
        SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(),
        TimeElapsedColumn(), Left(),
    )  # fmt: skip
    screen = Console(stderr=True)
    # What is said meanwhile stands above the bar, unless it goes into a file.
    above = sys.stdout.isatty()
    with Progress(*columns, console=screen, transient=True, redirect_stdout=above) as bars:
        task = bars.add_task("starting", total=1.0)

        def show(text: str, done: float) -> None:
            bars.update(task, description=printable(text), completed=done)

        yield show


class _Lines:
    """Progress as plain lines on stderr, never in quick succession."""

    def __init__(self):
        self.start = self.last = time.monotonic()
        self.estimate = TimeLeft()

    def __call__(self, text: str, done: float) -> None:
        now = time.monotonic()
        left = self.estimate(done, now)
        if now - self.last >= _SPARSE_S:
            self.last = now
            more = f" ({left})" if left else ""
            sys.stderr.write(f"[{now - self.start:4.0f} s] {printable(text)}{more}\n")
            sys.stderr.flush()


def show_record(record: Record, notes: Iterable[str]) -> None:
    """Print what was read and what was guessed about it."""
    first, *others = record_lines(record, notes)
    note(first)
    for text in others:
        note(f"  {text}")


def show_diagnosis(found: Diagnosis) -> None:
    """Print verdict, ladder, budget, findings and what to record next."""
    answer(f"{found.verdict}: {', '.join(found.effects)}" if found.effects else found.verdict)
    say(f"\n{headline(found)} ({found.verdict}).\n{found.sentence}\n")
    for text in found.notes:
        say(f"Note: {text}\n")
    table(*error_table(found.ladder, found.base.record, found.memoryless))
    if found.final.by_record:
        say()
        table(*run_table(found.final.by_record, found.base.record))
    say()
    table(("error budget", "RMS", "from"), budget_rows(found), numbers=False)
    if found.final.loss is not None and found.final.loss.cycles:
        say("\nLoss per cycle")
        table(*loss_table(found.final.loss, found.final.record))
    for finding in found.findings:
        others = f"; cannot be told from {', '.join(finding.family[1:])}"
        say(f"\n{finding.effect}{others if len(finding.family) > 1 else ''}")
        for name, text in finding_parameters(finding):
            say(f"  {name} = {text}")
    refused = [c for c in found.candidates if not c.accepted and c.step == len(found.effects)]
    if refused:
        best = max(refused, key=lambda c: c.gain)
        others = f" of the {len(refused)} effects" if len(refused) > 1 else ""
        title = "Not added" if best.why_not.startswith("not tried") else f"Best{others} not added"
        say(f"\n{title}: {best.effect} ({best.why_not})")
    if found.limits:
        say("\nNot found, and with 95 % confidence")
        for limit in found.limits:
            say(f"  {limit.effect}: {limit.text(found.budget.unit)}")
    if found.located:
        say(f"\nWhat remains: {found.located}")
        for text in found.remainder_in_words:
            say(f"  {text}")
    if found.form is not None:
        first, *others = form_lines(found)
        say(f"\n{first}")
        for text in others:
            say(f"  {text}")
    if found.next_experiment:
        say(f"\nRecord next: {found.next_experiment.text}\n  ({found.next_experiment.why})")
