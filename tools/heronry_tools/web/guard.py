"""Lets each request in or refuses it, and adds the security headers to every answer.

While a user watches this server's page, the same browser may show a page of another site. The other page can send
requests to this computer. Three checks refuse such requests:

    Origin    must be this server, if the request has an Origin; a POST (a question or an order) must have one
    Host      must be an address of this server. This stops DNS rebinding: a site loads its page, and then gives its own
              name the address of this computer
    token     must be right, if the table below requires the token

The server prints its address with the token after `#`. A browser never sends this part of an address. The server's own
page adds the token to its requests as `Authorization: Bearer TOKEN`, and to the address of a download. There is no
cookie, since a browser would also send it with the requests of other sites.

What a request needs depends on the address on which the server listens:

    request                         a loopback address                any other address
    page, style, scripts            nothing                           nothing (they contain no data of the system)
    reading, and questions          nothing                           the token
    orders                          --operate and the token           --operate and the token
"""

import ipaddress
import json
import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qs

from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADERS: Final[Mapping[str, str]] = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
_API: Final = "/api/"
_ORDERS: Final = "/api/order"
_LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "[::1]"})


@dataclass(frozen=True, slots=True)
class Access:
    """Where the server listens, and what its pages may do."""

    address: str  # an IP address
    port: int
    token: str  # the secret after `#` in the printed address
    operates: bool = False  # whether pages may give orders (--operate)

    @property
    def is_local(self) -> bool:
        """Tell whether only this computer can reach the server."""
        return ipaddress.ip_address(self.address).is_loopback

    def knows_host(self, host: str) -> bool:
        """Tell whether a `Host` may stand for this server: it has the server's port, and a name or address as below.

        If only this computer can reach the server, this is a loopback name or the address of the server.
        Otherwise it is a loopback name, the name of this computer, or any IP address.
        """
        name, _, port = host.rpartition(":")
        if port != str(self.port) or not name:
            return False
        if self.is_local:
            return name in _LOOPBACK_NAMES or name == self.address
        return name in _LOOPBACK_NAMES or name == socket.gethostname() or _is_address(name)

    def url(self, *, with_token: bool) -> str:
        """Return the address to open in a browser.

        with_token: whether the address contains the secret token, after `#`.
        """
        host = f"[{self.address}]" if ":" in self.address else self.address
        if ipaddress.ip_address(self.address).is_unspecified:  # the server listens on all addresses
            host = socket.gethostname()
        return f"http://{host}:{self.port}/" + (f"#token={self.token}" if with_token else "")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class Refusal:
    """The reason why a request is not let in, with the HTTP status code."""

    code: int
    sentence: str


@dataclass(frozen=True, slots=True)
class Asked:
    """The parts of a request that decide whether it is let in."""

    method: str
    path: str
    headers: Mapping[str, str]  # names in small letters
    query: str = ""


def refusal(access: Access, asked: Asked) -> Refusal | None:
    """Return the reason why a request is not let in; None where it is let in."""
    host, origin = asked.headers.get("host", ""), asked.headers.get("origin")
    if not access.knows_host(host):
        return Refusal(403, f"'{host}' is no address of this server: open {access.url(with_token=False)}")
    if origin is not None and origin != f"http://{host}":
        return Refusal(403, f"a page from {origin} must not send requests to this server")
    if asked.method not in ("GET", "HEAD", "POST"):
        return Refusal(405, f"this server does not accept the method {asked.method}")
    if asked.method == "POST":
        if origin is None:
            return Refusal(403, "a POST request must have the header Origin")
        if asked.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
            return Refusal(415, "a POST request must have the content type application/json")
    return _without_token(access, asked)


def _without_token(access: Access, asked: Asked) -> Refusal | None:
    is_order = asked.path == _ORDERS
    if is_order and not access.operates:
        return Refusal(403, "this server takes no orders: start the server with --operate to give orders")
    if not asked.path.startswith(_API) or (access.is_local and not is_order):
        return None
    given = asked.headers.get("authorization", "").removeprefix("Bearer ")
    given = given or parse_qs(asked.query).get("token", [""])[0]
    if secrets.compare_digest(given.encode(), access.token.encode()):
        return None
    return Refusal(401, "the token is missing or wrong: open the address that the server has printed, with its token")


class Guard:
    """An ASGI application that passes requests on to another application, or refuses them."""

    def __init__(self, inside: ASGIApp, access: Access) -> None:
        self._inside, self._access = inside, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on to the application inside the guard, or answer with the reason why it is refused."""
        if scope["type"] != "http":
            await self._inside(scope, receive, send)
            return

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", []), *own]}
            await send(message)

        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        asked = Asked(scope["method"], scope["path"], headers, scope["query_string"].decode("latin-1"))
        refused = refusal(self._access, asked)
        if refused is None:
            await self._inside(scope, receive, sealed)
            return
        body = json.dumps({"done": False, "sentence": refused.sentence}).encode()
        head = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
        await sealed({"type": "http.response.start", "status": refused.code, "headers": head})
        await sealed({"type": "http.response.body", "body": body})
