"""What the command line shows: texts and tables on stdout, progress on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from preisach_jax.quantity import pretty_unit, quantity

if TYPE_CHECKING:
    from rich.console import Console

    from preisach_jax.diagnosis.result import Diagnosis
    from preisach_jax.fit import Progress
    from preisach_jax.record import Record

_WIDTH = 110  # of tables that no terminal limits
_SPARSE_S = 2.0  # between two lines of progress that nobody may be reading


def console() -> Console:
    """The console of results; names from files are never taken for markup."""
    from rich.console import Console

    terminal = sys.stdout.isatty()
    return Console(highlight=False, markup=False, emoji=False, width=None if terminal else _WIDTH)


def say(text: str = "") -> None:
    """Print a text; lines are broken for a terminal only."""
    screen = console()
    screen.print(text, soft_wrap=not screen.is_terminal)


def table(headers: Sequence[str], rows: Iterable[Sequence[str]], numbers: bool = True) -> None:
    """Print a table, all but the first column to the right if they are numbers."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    drawn = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for position, header in enumerate(headers):
        drawn.add_column(header, justify="right" if numbers and position else "left")
    for row in rows:
        drawn.add_row(*row)
    console().print(drawn)


@contextmanager
def progress() -> Iterator[Progress]:
    """A bar on stderr if that is a terminal, else a line every now and then."""
    if sys.stderr.isatty():
        with _bar() as show:
            yield show
    else:
        yield _Lines()


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(),
        TimeElapsedColumn(),
    )  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("starting", total=1.0)

        def show(text: str, done: float) -> None:
            bars.update(task, description=text, completed=done)

        yield show


class _Lines:
    """Progress as plain lines on stderr, never in quick succession."""

    def __init__(self):
        self.start = self.last = time.monotonic()

    def __call__(self, text: str, done: float) -> None:
        del done
        now = time.monotonic()
        if now - self.last >= _SPARSE_S:
            self.last = now
            sys.stderr.write(f"[{now - self.start:4.0f} s] {text}\n")
            sys.stderr.flush()


def show_record(record: Record, notes: Iterable[str]) -> None:
    """Print what was read and what was guessed about it."""
    parts = []
    for role, channel in record.channels.items():
        unit = pretty_unit(channel.unit)
        name = channel.name if role == channel.name else f"{role} {channel.name}"
        parts.append(f"{name} ({unit or 'no unit'})")
    rows, span = len(record.time), quantity(record.duration_s, "s")
    say(f"{record.name}: {rows:,} rows, {span}; {', '.join(parts)}")
    for note in (*notes, *_holes(record)):
        say(f"  {note}")


def _holes(record: Record) -> list[str]:
    """What is missing in a record: stretches of time, and outputs."""
    found = []
    if record.gaps:
        row, seconds = max(record.gaps, key=lambda gap: gap[1])
        others = f", and {len(record.gaps) - 1} shorter ones" if len(record.gaps) > 1 else ""
        found.append(f"a gap of {quantity(seconds, 's', 3)} before sample {row + 1:,}{others}")
    if unmeasured := int((~record.measured).sum()):
        found.append(f"{unmeasured:,} samples without a measured output: history of the input only")
    return found


def show_diagnosis(found: Diagnosis) -> None:
    """Print verdict, ladder, budget, findings and what to record next."""
    from preisach_jax.rows import budget_rows, finding_parameters, headline, ladder_rows

    say(f"\n{headline(found)} ({found.verdict}).\n{found.sentence}\n")
    for note in found.notes:
        say(f"Note: {note}\n")
    rows = ladder_rows(found)
    unit = f" ({rows[0]['unit']})" if rows[0]["unit"] else ""
    keys = ("model", "rms_validation", "percent_of_stroke", "max_abs_validation", "fit_percent")
    table(
        ("model", f"held-out RMS{unit}", "% of stroke", f"largest{unit}", "fit %"),
        [[row[key] for key in keys] for row in rows],
    )
    say()
    table(("error budget", "RMS", "from"), budget_rows(found), numbers=False)
    for finding in found.findings:
        others = f"; cannot be told from {', '.join(finding.family[1:])}"
        say(f"\n{finding.effect}{others if len(finding.family) > 1 else ''}")
        for name, text in finding_parameters(finding):
            say(f"  {name} = {text}")
    refused = [c for c in found.candidates if not c.accepted and c.step == len(found.effects)]
    if refused:
        best = max(refused, key=lambda c: c.gain)
        others = f" of the {len(refused)} effects" if len(refused) > 1 else ""
        say(f"\nBest{others} not added: {best.effect} ({best.why_not})")
    if found.limits:
        say("\nNot found, and with 95 % confidence")
        for limit in found.limits:
            say(f"  {limit.effect}: {limit.text(found.budget.unit)}")
    if found.located:
        say(f"\nWhat remains: {found.located}")
    if found.next_experiment:
        say(f"\nRecord next: {found.next_experiment.text}\n  ({found.next_experiment.why})")
