"""What the commands share that work in a folder by chunks, on one process or many."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from preisach_jax.cli import screen
from preisach_jax.errors import InputError

Found = TypeVar("Found")

Chunk = Annotated[
    int, typer.Option(metavar="C", help="records that are computed together and then written")
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume/--restart", help="resume what the folder holds, or delete it and start again"
    ),
]
Distributed = Annotated[
    bool, typer.Option("--distributed", help="share it with the processes of a Slurm or MPI job")
]
Coordinator = Annotated[
    str | None,
    typer.Option(metavar="HOST:PORT", help="without Slurm or MPI: where process 0 is reached"),
]
Processes = Annotated[
    int | None, typer.Option(metavar="P", help="how many processes share the work")
]
Process = Annotated[int | None, typer.Option(metavar="I", help="which of them this is, from 0")]


class Interrupted(Exception):  # noqa: N818 - it is the user's wish, and no error
    """The user interrupted a command that can go on later; the message says how."""


def check_work(
    out: Path, work: str, item: str, read: Sequence[Path], result: str, force: bool
) -> None:
    """Make sure that a folder can take long work, and that what it would replace is ours.

    Arguments:
        out: the folder.
        work, item: as `Chunks` has them.
        read: the files that are read.
        result: name of the file of results.
        force: whether what no command wrote may be replaced.

    Raises:
        InputError: if not.
    """
    from preisach_jax.files import check_folder
    from preisach_jax.work.chunks import DONE, MANIFEST

    check_folder(out, read, [MANIFEST, result], force=force)
    # Arrays and notes that a crash has damaged do not tell whose they are: the manifest, which is
    # written before them, does.
    manifest = out / MANIFEST
    told = manifest.read_text(errors="replace") if manifest.exists() else '"work": "none"'
    if force or '"work": "' not in told or f'"work": "{work}"' in told:
        return
    for path in (out / f"{work}.zarr", *out.glob(f"{DONE}/{item}s_*.json")):
        if path.exists():
            raise InputError(
                f"{path}: no {work} of preisach_jax in {out} wrote this, and a new one would "
                "replace it; choose another place, or --force"
            )


def start_devices(
    distributed: bool, coordinator: str | None, processes: int | None, process: int | None
) -> None:
    """Take all cores of this process, and join the others if there are any.

    Raises:
        InputError: if they cannot be joined.
    """
    from preisach_jax.devices import connect, use_all_cores

    use_all_cores()
    by_hand = (coordinator, processes, process)
    if distributed or any(one is not None for one in by_hand):
        named_by_option(("coordinator", "process"), connect, *by_hand)


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


def run_in_folder(out: Path, command: str, run: Callable[..., Found]) -> Found:
    """Run by chunks into a folder, with progress, and tell how to go on if it is interrupted.

    Arguments:
        out: the folder.
        command: the command line.
        run: takes `progress` and `announce`.

    Raises:
        Interrupted: if the user interrupts.
    """
    from preisach_jax.devices import is_first, quiet_output

    notes: list[str] = []
    try:
        with screen.progress() as show, quiet_output():
            found = run(progress=show if is_first() else None, announce=notes.append)
    except KeyboardInterrupt:
        again = shlex.join(word for word in shlex.split(command) if word != "--restart")
        raise Interrupted(
            f"interrupted; {out} keeps the finished chunks; resume with: {again}"
        ) from None
    for note in notes:
        screen.note(note)
    return found
