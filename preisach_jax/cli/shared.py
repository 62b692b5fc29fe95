"""What commands have in common: examples, `--json`, `--quiet`, double precision, interruptions."""

from __future__ import annotations

import functools
import inspect
import logging
import shlex
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import READING, reading
from preisach_jax.cli.process import kept_between_runs, why_not_kept
from preisach_jax.errors import InputError

FIRST_RUN = (
    "The first run on this machine compiles the program: this takes about half a minute more, once."
)

EXAMPLES = "examples"
"""Attribute of a command: lines for the end of its help."""

_Json = Annotated[
    bool, typer.Option("--json", help="show the result as one JSON document, and nothing else")
]
_Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="show nothing but errors")]
_OPTIONS = {"as_json": _Json, "quiet": _Quiet}


def command(
    *examples: str, fits: bool = False, computes: bool = True, reads: Iterable[str] = ()
) -> Callable[[Callable[..., Any]], Callable[..., None]]:
    """Make a function a command.

    What the function returns is what `--json` shows: anything that JSON can hold once NumPy's
    numbers are made Python's, or None for nothing. What it prints by `screen.say` and
    `screen.table` is for people; `--json` and `--quiet` silence it.

    Arguments:
        fits: whether the command fits models, which compiles for a while on the first run.
        computes: whether it needs JAX, which takes half a second to load.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., None]:
        @functools.wraps(function)
        def run(*arguments: Any, as_json: bool = False, quiet: bool = False, **named: Any) -> None:
            if reads:
                named["columns"] = reading({name: named.pop(name, None) for name in reads})
            if not computes:
                with screen.manner(as_json=as_json, quiet=quiet):
                    content = function(*arguments, **named)
                    if content is not None:
                        screen.show_json(content)
                return
            import jax

            # That a home cannot be written to is said once, below.
            logging.getLogger("matplotlib").setLevel(logging.ERROR)
            # Identification needs double precision, for the command alone: whoever calls `main`
            # from a program of their own keeps the precision that they have.
            with (
                screen.manner(as_json=as_json, quiet=quiet),
                jax.enable_x64(True),
                kept_between_runs() as first,
            ):
                if fits and (said := FIRST_RUN if first else why_not_kept()):
                    screen.note(said)
                content = function(*arguments, **named)
                if content is not None:
                    screen.show_json(content)

        # Typer reads the options of a command from its signature.
        own = inspect.signature(function, locals={"ReadOptions": dict}, eval_str=True)
        shown: list[inspect.Parameter] = []
        for parameter in own.parameters.values():
            if parameter.name == "columns":
                shown += [_option(name, None, READING[name]) for name in reads]
            else:
                shown.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
        shown += [_option(name, False, kind) for name, kind in _OPTIONS.items()]
        run.__signature__ = own.replace(  # pyright: ignore[reportAttributeAccessIssue]
            parameters=shown, return_annotation=None
        )
        run.__annotations__ = {each.name: each.annotation for each in shown}
        setattr(run, EXAMPLES, examples)
        return run

    return decorate


def _option(name: str, default: Any, kind: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)


Found = TypeVar("Found")

Resume = Annotated[
    bool,
    typer.Option(
        "--resume/--restart", help="resume what the folder holds, or delete it and start again"
    ),
]


class Interrupted(Exception):  # noqa: N818 - it is the user's wish, and no error
    """The user interrupted a command that can go on later; the message says how."""


def named_by_option(names: Sequence[str], check: Callable[..., Found], *arguments: Any) -> Found:
    """Call what checks arguments; the names that its messages begin with are those of options."""
    try:
        return check(*arguments)
    except InputError as error:
        named = str(error).startswith(tuple(names))
        if not named:
            raise
        name, rest = str(error).split(maxsplit=1)
        raise InputError(f"--{name.replace('_', '-')} {rest}") from error


@contextmanager
def resumable(out: Path, command: str) -> Generator[None]:
    """Tell of an interruption inside how to go on: by the same command line."""
    try:
        yield
    except KeyboardInterrupt:
        again = shlex.join(word for word in shlex.split(command) if word != "--restart")
        raise Interrupted(
            f"interrupted; {out} keeps what was finished; resume with: {again}"
        ) from None
