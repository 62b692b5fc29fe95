"""All commands together, and the one place where failures become messages and exit codes."""

from __future__ import annotations

import os
import shlex
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer
from typer.main import get_command

from preisach_jax.cli import commands, demonstration, paper, screen
from preisach_jax.cli.commands import app, compare, compensate, design, export
from preisach_jax.cli.fleet import fleet
from preisach_jax.cli.look import look
from preisach_jax.cli.process import INTERRUPTED
from preisach_jax.cli.shared import EXAMPLES, Interrupted
from preisach_jax.errors import InputError
from preisach_jax.escape import printable

OK, FAILURE, USER_MISTAKE = 0, 1, 2

COMPLETION = "_PREISACH_COMPLETE"
"""Environment variable by which a shell asks how a command line could go on."""

TRACEBACK = "PREISACH_TRACEBACK"
"""Environment variable; if set to anything but 0, failures come with a traceback."""

_COMMANDS: tuple[Callable[..., Any], ...] = (
    look,
    commands.diagnose,
    app,
    commands.fit,
    compare,
    design,
    commands.predict,
    export,
    compensate,
    commands.simulate,
    commands.effects,
    fleet,
    paper.sweep,
    paper.figures,
    demonstration.demo,
)


def build() -> typer.Typer:
    """The application with all its commands."""
    app = typer.Typer(
        name="preisach",
        help=commands.__doc__,
        epilog=_epilog(commands.FIRST_STEPS),
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(commands.common)
    for command in _COMMANDS:
        app.command(epilog=_epilog(getattr(command, EXAMPLES)))(command)
    return app


def _epilog(examples: tuple[str, ...]) -> str:
    """The examples as the end of a help text; `\\b` keeps its lines as they are."""
    return "\n".join(["\b", "Examples:", *(f"  {example}" for example in examples)])


def run(words: list[str]) -> int:
    """Run a command; every failure becomes one line on stderr."""
    for stream in (sys.stdout, sys.stderr):
        # A terminal that has no µ shows a question mark, and the work is not lost for it.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # pyright: ignore[reportAttributeAccessIssue]
    if not words and COMPLETION not in os.environ:  # a shell asks there, and gives no words
        return start()
    try:
        command = get_command(build())
        context = {"command": shlex.join(["preisach", *words])}
        code = command.main(words, prog_name="preisach", standalone_mode=False, obj=context)
    except InputError as error:
        return _complain(str(error), USER_MISTAKE)
    except Interrupted as interruption:
        return _complain(str(interruption), INTERRUPTED)
    except typer.Abort:
        return _complain("interrupted", INTERRUPTED)
    except OSError as error:
        if error.filename is None:
            return _fail(error)
        return _complain(f"{error.filename}: {error.strerror}", USER_MISTAKE)
    except MemoryError:
        return _complain("there is not enough memory; use fewer --levels or less data", FAILURE)
    except Exception as error:
        if not hasattr(error, "format_message"):
            return _fail(error)
        return _complain(_usage(error), USER_MISTAKE)
    if code == INTERRUPTED:  # so typer ends when it catches the interruption itself
        return _complain("interrupted", INTERRUPTED)
    return code if isinstance(code, int) else OK


def _usage(error: Any) -> str:
    """What typer has to say about options and arguments, with where to read more."""
    message = error.format_message().rstrip(".")
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "preisach"
    return f"{message}; see '{path} --help'"


def _fail(error: Exception) -> int:
    if os.environ.get(TRACEBACK, "0") not in {"", "0"}:
        traceback.print_exception(error)
    return _complain(
        f"internal error: {type(error).__name__}: {error} "
        f"(set {TRACEBACK}=1 for the traceback, and report it)",
        FAILURE,
    )


def _complain(message: str, code: int) -> int:
    sys.stderr.write(f"preisach: {printable(' '.join(message.split()))}\n")
    return code


_READ = frozenset(
    ".csv .txt .dat .tsv .asc .lvm .tdms .xlsx .xls .ods .h5 .hdf5 .mat .npz .npy .parquet "
    ".feather .forc .frc .gz .zip".split()
)
_MOST_SHOWN = 5
_MOST_LISTED = 2_000
_MODEL_BYTES = 400

_NOTHING_HERE = (
    ("preisach demo", "a diagnosis of a measured record that comes with the program"),
    ("preisach simulate --effects creep --out stage.csv", "a record of a simulated stage"),
    ("preisach diagnose stage.csv", "which effect is missing in it, with a report"),
)


def start(folder: Path | None = None) -> int:
    """Print the first commands, with the records and models in a folder as their arguments."""
    records, models, reports = _found(folder or Path())
    screen.say("preisach finds out which physical effect a hysteresis model lacks.\n")
    lines = list(_NOTHING_HERE)
    if records:
        shown = ", ".join(path.name for path in records[:_MOST_SHOWN])
        more = f" and {len(records) - _MOST_SHOWN} more" if len(records) > _MOST_SHOWN else ""
        screen.say(f"Files here that may be records: {shown}{more}\n")
        name = _quoted(records[0].name)
        lines = [
            (f"preisach look {name}", "what it holds and what it can tell, in seconds"),
            (f"preisach diagnose {name}", "which effect is missing, with a report"),
            (f"preisach app {name}", "the same by hand, in a page on this machine"),
        ]
    else:
        screen.say("There is no record here (CSV, Excel, TDMS, HDF5, MAT, ...). To begin:\n")
    if models and records:
        model = _quoted(models[0].as_posix())
        text = "an existing model against a record"
        lines.append((f"preisach compare {model} {_quoted(records[0].name)}", text))
    if reports:
        text = "what to record next, from the last diagnosis"
        lines.append((f"preisach design {_quoted(reports[0].as_posix())} --out next.csv", text))
    lines.append(("preisach --help", "all commands"))
    width = max(len(line) for line, _ in lines)
    for line, text in lines:
        screen.say(f"  {line:{width}}  {text}")
    return 0


def _found(folder: Path) -> tuple[list[Path], list[Path], list[Path]]:
    """Records, the newest first; models; and folders with a report."""
    records: list[tuple[float, Path]] = []
    models: list[Path] = []
    reports: list[Path] = []
    try:
        entries = sorted(folder.iterdir())[:_MOST_LISTED]
    except OSError:
        return [], [], []
    for path in entries:
        try:
            if path.is_dir():
                if (path / "diagnosis.json").is_file():
                    reports.append(path)
                if (path / "model.json").is_file() and _is_model(path / "model.json"):
                    models.append(path / "model.json")
            elif path.suffix.lower() in _READ and path.stat().st_size:
                records.append((path.stat().st_mtime, path))
            elif path.suffix.lower() == ".json" and _is_model(path):
                models.append(path)
        except OSError:
            continue
    return [path for _, path in sorted(records, reverse=True)], models, reports


def _is_model(path: Path) -> bool:
    with path.open("rb") as file:
        return b"preisach" in file.read(_MODEL_BYTES)


def _quoted(name: str) -> str:
    return f'"{name}"' if set(name) - _PLAIN else name


_PLAIN = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-/")
