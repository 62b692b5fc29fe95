"""Serving the page to this machine alone."""

from __future__ import annotations

import importlib
import os
import socket
import threading
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import panel as pn
from bokeh.events import DocumentReady
from bokeh.models import CustomJS

from preisach_jax.app import panels
from preisach_jax.app.page import Page

TITLE = "preisach"

READING = ("pandas", "scipy.ndimage", "scipy.special", "scipy.fft")
"""What is imported when the first file is read and looked at, and takes most of a second then."""


def serve(
    data: Path | None = None,
    *,
    port: int = 0,
    address: str = "127.0.0.1",
    show: bool = True,
    threaded: bool = False,
) -> Any:
    """Serve the page until interrupted.

    Arguments:
        data: a file to begin with.
        port: where to listen; 0 for any that is free.
        address: the interface to listen on; by default this machine's loopback.
        show: whether to open a browser.
        threaded: whether to return at once, with a server that has `stop`.

    Returns:
        The server's thread if it is threaded, else nothing before it ends.

    Example:
        >>> serve(Path("stage.csv"))  # doctest: +SKIP
    """
    # Nothing is fetched from elsewhere: all scripts and styles come with the installed packages.
    os.environ.setdefault("BOKEH_RESOURCES", "server")
    pn.extension(notifications=False, respect_explicit_sizing=True)

    # Done while the browser opens, so that the first file that is dropped need not wait for it.
    threading.Thread(target=_load, args=(READING,), daemon=True).start()

    def page() -> Any:
        opened = Page(data)
        script = files("preisach_jax.app").joinpath("layout.js").read_text(encoding="utf-8")
        pn.state.onload(panels.share_styles)
        document: Any = pn.state.curdoc
        document.js_on_event(DocumentReady, CustomJS(code=script))
        pn.state.on_session_destroyed(lambda context: opened.close())
        return opened.view

    port = port or free_port(address)
    # A page of another origin, open in the same browser, must not talk to this server.
    origins = [f"{host}:{port}" for host in {address, "localhost"}]
    return pn.serve(
        {"/": page}, port=port, address=address, websocket_origin=origins, show=show,
        threaded=threaded, title=TITLE, verbose=False,
    )  # fmt: skip


def _load(modules: Sequence[str]) -> None:
    for name in modules:
        importlib.import_module(name)


def free_port(address: str) -> int:
    with socket.socket() as listening:
        listening.bind((address, 0))
        return listening.getsockname()[1]
