"""The command line: `preisach COMMAND ...`.

`main` is the one place where failures become messages and exit codes: 0 is success, 2 a mistake of
the user's (one line on stderr), 1 a failure of ours, 130 an interruption.
"""

from __future__ import annotations

import os
import shlex
import sys
import traceback
from collections.abc import Sequence

import typer
from typer.main import get_command

from preisach_jax.cli import commands, demonstration, paper
from preisach_jax.cli.design import design
from preisach_jax.cli.fleet import fleet
from preisach_jax.cli.resumable import Interrupted
from preisach_jax.errors import InputError

__all__ = ["main"]

OK, FAILURE, USER_MISTAKE, INTERRUPTED = 0, 1, 2, 130

TRACEBACK = "PREISACH_TRACEBACK"
"""Environment variable; if set to anything but 0, failures come with a traceback."""


def build() -> typer.Typer:
    """The application with all its commands."""
    app = typer.Typer(
        name="preisach",
        help=commands.__doc__,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(commands.common)
    app.command()(commands.diagnose)
    app.command()(commands.fit)
    app.command()(commands.compare)
    app.command()(design)
    app.command()(commands.predict)
    app.command()(commands.simulate)
    app.command()(commands.effects)
    app.command()(fleet)
    app.command()(paper.sweep)
    app.command()(paper.figures)
    app.command()(demonstration.demo)
    return app


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Arguments:
        arguments: words behind `preisach`; by default those of the process.

    Returns:
        The exit code.

    Example:
        >>> main(["effects", "crep"])
        2
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        # A terminal that has no µ shows a question mark, and the work is not lost for it.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # pyright: ignore[reportAttributeAccessIssue]
    code = _run(words)
    if code != OK and "preisach_jax.devices" in sys.modules:
        from preisach_jax.devices import abandon

        abandon(code)
    return code


def _run(words: list[str]) -> int:
    try:
        command = get_command(build())
        context = {"command": shlex.join(["preisach", *words])}
        code = command.main(
            words or ["--help"], prog_name="preisach", standalone_mode=False, obj=context
        )
    except InputError as error:
        return _complain(str(error), USER_MISTAKE)
    except Interrupted as interruption:
        return _complain(str(interruption), INTERRUPTED)
    except (typer.Abort, KeyboardInterrupt):
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


def _usage(error: Exception) -> str:
    """What typer has to say about options and arguments, with where to read more."""
    message = error.format_message().rstrip(".")  # pyright: ignore[reportAttributeAccessIssue]
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "preisach"
    return f"{message}; see '{path} --help'"


def _fail(error: Exception) -> int:
    if os.environ.get(TRACEBACK, "0") not in {"", "0"}:
        traceback.print_exception(error)
    return _complain(
        f"this is a failure of the program, not of yours: {type(error).__name__}: {error} "
        f"(set {TRACEBACK}=1 for the traceback, and report it)",
        FAILURE,
    )


def _complain(message: str, code: int) -> int:
    sys.stderr.write(f"preisach: {' '.join(message.split())}\n")
    return code
