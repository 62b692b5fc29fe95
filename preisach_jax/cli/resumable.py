"""What the commands share that keep what they have finished, and go on after an interruption."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from preisach_jax.errors import InputError

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
