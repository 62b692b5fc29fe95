"""All commands together, and the one place where failures become messages and exit codes."""

from __future__ import annotations

import os
import shlex
import sys
import traceback
from collections.abc import Callable
from typing import Any

import typer
from typer.main import get_command

from preisach_jax.cli import commands, demonstration, paper
from preisach_jax.cli.compare import compare
from preisach_jax.cli.compensation import compensate
from preisach_jax.cli.design import design
from preisach_jax.cli.export import export
from preisach_jax.cli.fleet import fleet
from preisach_jax.cli.interruption import INTERRUPTED
from preisach_jax.cli.look import look
from preisach_jax.cli.page import app
from preisach_jax.cli.resumable import Interrupted
from preisach_jax.cli.shared import EXAMPLES
from preisach_jax.cli.start import start
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
