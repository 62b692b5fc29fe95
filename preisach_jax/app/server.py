"""Serving the page to this machine alone."""

from __future__ import annotations

import errno
import importlib
import os
import socket
import threading
import webbrowser
from collections.abc import Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import panel as pn
from bokeh.events import DocumentReady
from bokeh.models import CustomJS
from panel.io import server as panel_server

from preisach_jax.app import panels
from preisach_jax.app.guard import Guard
from preisach_jax.app.page import Page
from preisach_jax.errors import InputError

TITLE = "preisach"

READING = ("pandas", "scipy.ndimage", "scipy.special", "scipy.fft")
"""What is imported when the first file is read and looked at, and takes most of a second then."""


class PageServer:
    """A server of the page, which listens from the beginning and answers while it runs.

    Attributes:
        port: where it listens.
        url: the whole address of the page, with the token that it asks for.
        is_open: whether other machines may reach it.
    """

    def __init__(self, data: Path | None = None, *, port: int = 0, address: str = "127.0.0.1"):
        # Nothing is fetched from elsewhere: all scripts and styles come with the installed
        # packages.
        os.environ.setdefault("BOKEH_RESOURCES", "server")
        pn.extension(notifications=False, respect_explicit_sizing=True)
        self.port = free_port(address, port)
        guard = Guard(address, self.port)

        def page() -> Any:
            document: Any = pn.state.curdoc
            opened = Page()
            script = files("preisach_jax.app").joinpath("layout.js").read_text(encoding="utf-8")
            document.js_on_event(DocumentReady, CustomJS(code=script))
            pn.state.onload(panels.share_styles)
            if data is not None:
                # When the page has come to a browser that has opened its socket: what only asks
                # for the page, as an image of another site may, makes no work.
                pn.state.onload(partial(opened.open_file, data))
            pn.state.on_session_destroyed(lambda context: opened.close())
            return opened.view

        # Cookies and headers, the token among them, are no matter of the page.
        serve: Any = vars(panel_server)["get_server"]  # its types are known in part only
        self._server: Any = serve(
            {"/": page}, port=self.port, address=address, show=False, title=TITLE, verbose=False,
            include_headers=[], include_cookies=[],
        )  # fmt: skip
        application = self._server._tornado
        application.websocket_origins.add("*")  # the guard is asked first, and knows better
        guard.guard(application)
        shown = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(address, address)
        shown = f"[{shown}]" if ":" in shown else shown
        self.is_open = not guard.is_loopback
        self.url = f"http://{shown}:{self.port}/?token={guard.token}"

    def run(self, *, show: bool = True) -> None:
        """Answer until interrupted or stopped.

        Arguments:
            show: whether to open a browser.
        """
        # Done while the browser opens, so that the first file that is dropped need not wait for it.
        threading.Thread(target=_load, args=(READING,), daemon=True).start()
        if show:
            self._server.io_loop.add_callback(webbrowser.open, self.url)
        self._server.start()
        self._server.io_loop.start()

    def stop(self) -> None:
        """End `run`, from another thread."""
        self._server.io_loop.add_callback(self._server.io_loop.stop)


def _load(modules: Sequence[str]) -> None:
    for name in modules:
        importlib.import_module(name)


def free_port(address: str, port: int = 0) -> int:
    """The port if this machine can listen there; for 0 any that it can."""
    if not 0 <= port <= 65535:
        raise InputError(f"the port is {port}; give one from 1024 to 65535, or 0")
    try:
        [(family, *_, place), *_] = socket.getaddrinfo(
            address or "?", port, type=socket.SOCK_STREAM
        )
        with socket.socket(family) as listening:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(place)
            listening.listen()
            return listening.getsockname()[1]
    except (OSError, UnicodeError) as error:
        code = error.errno if isinstance(error, OSError) else None
        if code == errno.EADDRINUSE:
            raise InputError(
                f"the port {port} of {address} is in use; give another one, or 0 for any"
            ) from None
        if code == errno.EACCES:
            raise InputError(
                f"the port {port} is not for all to use; give one from 1024 to 65535"
            ) from None
        raise InputError(
            f"the address {address!r:.80} is none that this machine listens on; give 127.0.0.1, "
            "or one of its own"
        ) from None
