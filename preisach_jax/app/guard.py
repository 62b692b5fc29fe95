"""Who may talk to the page: its own address, and who was given its token."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from typing import Any, cast
from urllib.parse import urlsplit

from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher, Rule
from tornado.web import Application, RequestHandler

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
