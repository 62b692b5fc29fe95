"""`preisach app`: the interactive page."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError


@command("preisach app", "preisach app stage.csv --port 5006")
def app(
    data: Annotated[
        Path | None, typer.Argument(metavar="[DATA]", help="a file to begin with")
    ] = None,
    port: Annotated[
        int, typer.Option(metavar="PORT", help="where to listen; 0: any that is free")
    ] = 0,
    address: Annotated[
        str, typer.Option(metavar="IP", help="interface to listen on; others can then see the page")
    ] = "127.0.0.1",
    browser: Annotated[bool, typer.Option(help="open a browser")] = True,
) -> dict[str, Any]:
    """Look at a record, add what its model lacks, in a page on this machine."""
    if data is not None and not data.is_file():
        raise InputError(f"{data}: there is no such file; check the path")
    if missing := [name for name in ("bokeh", "panel") if find_spec(name) is None]:
        raise InputError(
            f"the page needs {' and '.join(missing)}; install with pip install 'preisach_jax[app]'"
        )
    from preisach_jax.app.server import PageServer

    server = PageServer(data, port=port, address=address)
    if server.is_open:
        screen.note(
            f"Warning: from other machines, too, this page can be reached at {address}, and what "
            "it sends is not encrypted. It asks for the token in its address: tell it nobody else."
        )
    screen.note(f"{server.url} (Ctrl-C ends it)")
    screen.answer(server.url)
    server.run(show=browser)
    return {"address": server.url}
