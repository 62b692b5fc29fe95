"""Serving the page to this machine alone, and to who was given its token."""

from __future__ import annotations

import errno
import hmac
import importlib
import ipaddress
import os
import secrets
import socket
import threading
import webbrowser
from collections.abc import Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, cast
from urllib.parse import urlsplit

import panel as pn
from bokeh.events import DocumentReady
from bokeh.models import CustomJS
from panel.io import server as panel_server
from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher, Rule
from tornado.web import Application, RequestHandler

from preisach_jax.app import panels
from preisach_jax.app.page import Page
from preisach_jax.errors import InputError

HOST = "This page answers only under the address that preisach app has printed."
ORIGIN = "This page answers only to its own scripts."
TOKEN = (
    "This page asks for its token: open the whole address that preisach app has printed, in the "
    "terminal where it runs."
)


class Guard(Matcher):
    """Stands before all handlers of a server, and matches what they must not see.

    A name that is not in the list may be one that an attacker's name server lets point here, so
    that scripts of his page are taken for scripts of this one; an address in figures cannot.

    Attributes:
        token: what a request must know; another one at each start.
        is_loopback: whether the interface is one that only this machine has.
    """

    def __init__(self, address: str, port: int):
        self.token = secrets.token_urlsafe(24)
        self._port = port
        self._cookie = f"preisach_{port}"  # browsers keep cookies by host, whatever the port
        ip = _ip(address)
        self._is_open = ip is not None and ip.is_unspecified
        self._names = {_name(address)}
        self.is_loopback = address == "localhost" or (ip is not None and ip.is_loopback)
        if self._is_open or self.is_loopback:
            self._names |= {"localhost", "127.0.0.1", "::1"}
        if self._is_open:
            self._names.add(socket.gethostname().lower())

    def guard(self, application: Application) -> None:
        """Be asked before each handler of an application: pages, scripts, files and sockets."""
        application.default_router.rules.insert(0, Rule(self, _Answer))

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """What to answer in place of a handler, None where it may see the request."""
        hosts, origins = (request.headers.get_list(key) for key in ("Host", "Origin"))
        if len(hosts) != 1 or not self._is_here(f"http://{hosts[0]}"):
            return {"target_kwargs": {"refusal": HOST}}
        is_socket = "Upgrade" in request.headers
        if (is_socket and not origins) or not all(map(self._is_here, origins)):
            return {"target_kwargs": {"refusal": ORIGIN}}
        cookies = cast(dict[str, Any], request.cookies)  # pyright: ignore[reportUnknownMemberType]
        if self._cookie in cookies and self._is_token(cookies[self._cookie].value.encode()):
            return None
        if not any(map(self._is_token, request.query_arguments.get("token", []))):
            return {"target_kwargs": {"refusal": TOKEN}}
        if request.path != "/":
            return None
        return {"target_kwargs": {"cookie": (self._cookie, self.token)}}

    def _is_token(self, given: bytes) -> bool:
        return hmac.compare_digest(given, self.token.encode())

    def _is_here(self, url: str) -> bool:
        try:
            parts = urlsplit(url)
            name, port = _name(parts.hostname or ""), parts.port or 80
        except ValueError:
            return False
        is_plain = parts.scheme == "http" and not (parts.path or parts.query or "@" in parts.netloc)
        is_known = name in self._names or (self._is_open and _ip(name) is not None)
        return is_plain and is_known and port == self._port


class _Answer(RequestHandler):
    """A refusal in one sentence; or the token as a cookie, and the page without it in its address.

    A request that another site's page makes for an image, a frame or a script has no such cookie.
    """

    def initialize(self, refusal: str = "", cookie: tuple[str, str] | None = None) -> None:
        self._refusal, self._kept = refusal, cookie

    def prepare(self) -> None:
        self.set_header("Cache-Control", "no-store")
        if self._kept is not None:
            self.set_cookie(*self._kept, httponly=True, samesite="Lax")
            self.redirect("/", status=303)
            return
        self.set_status(403)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(self._refusal + "\n")


def _ip(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(address)
    except ValueError:
        return None


def _name(host: str) -> str:
    """A host as it is compared: names in small letters, addresses in their shortest form."""
    return str(_ip(host) or host.lower())


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
