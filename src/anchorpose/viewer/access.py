"""Control the access to a page's server. Only the page that this program opened may send requests to the server, over a
limited number of connections.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from threading import Condition
from typing import Final
from urllib.parse import urlsplit

TOKEN_BYTES: Final = 24


@dataclass(frozen=True, slots=True)
class Guard:
    """The rule that decides which requests are served.

    The token, a secret text, must be the first part of the path of every request. If the server listens on a loopback
    address (reachable from this machine only), the Host header must also be a loopback name. This refuses requests from
    the page of another site whose name points to this machine (DNS rebinding), since the header of such a request has
    the name of that site. A request that changes data must come from the page of this server.
    """

    token: str
    port: int
    loopback: bool

    def path_within(self, path: str) -> str | None:
        """Return the rest of a request's path after the token, without the query; None if the token is missing."""
        first, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
        return rest if hmac.compare_digest(first.encode(), self.token.encode()) else None

    def host_is_ours(self, headers: Mapping[str, str]) -> bool:
        """Return whether the request was made to a name of this machine; True for every request if the server does not
        listen on loopback. Any port is allowed, since with a tunnel (port forwarding) the browser may use another port
        than the server.
        """
        return not self.loopback or is_loopback(_name_in(headers.get("Host", "")))

    def comes_from_the_page(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request that changes data was made by the page of this server, according to the origin that
        the browser states. Browsers let the page of another site send JSON to a server only if this server permits it,
        and this server never does.
        """
        origin, host = headers.get("Origin"), headers.get("Host", "")
        return headers.get("Content-Type", "") == "application/json" and origin == f"http://{host}"


def new_token() -> str:
    """Return a new token: a random text that cannot be guessed, of characters that are valid in an address."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def _name_in(host: str) -> str:
    """Return the name in a Host header without its port; empty if it is malformed."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach the address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


# maximum number of open connections to the server; each is an open file, and some systems allow a program only 256 of
# them
MOST: Final = 48
# maximum number of open connections from one client address: enough for four browser windows with six connections each
MOST_PER_CLIENT: Final = 24
CLOSING_S: Final = 1.0  # s, maximum time that a connection may take to close after it was shut down


@dataclass(slots=True, eq=False)
class _Connection:
    request: socket.socket
    client: str
    known: bool = False  # whether the connection has sent a request with the token
    leaving: bool = False


class Connections:
    """The open connections to the server. If too many are open, the oldest connection that has not sent the token is
    closed to make space for a new connection.
    """

    def __init__(self) -> None:
        self._open: list[_Connection] = []
        self._changed = Condition()

    def add(self, request: socket.socket, client: str) -> bool:
        """Return whether a new connection from the address ``client`` is allowed; if so, the connection counts as open
        from now on.
        """
        with self._changed:
            while full := self._in_the_way(client):
                strangers = [one for one in full if not one.known and not one.leaving]
                if not strangers or not self._close(strangers[0]):
                    return False
            self._open.append(_Connection(request, client))
        return True

    def trust(self, request: socket.socket) -> None:
        """Note that a connection has sent the token. Such a connection is never closed to make space for a new
        connection.
        """
        with self._changed:
            for one in self._open:
                one.known |= one.request is request

    def remove(self, request: socket.socket) -> None:
        """Note that a connection is closed."""
        with self._changed:
            self._open = [one for one in self._open if one.request is not request]
            self._changed.notify_all()

    def _in_the_way(self, client: str) -> list[_Connection]:
        """Return an empty list if a new connection from ``client`` is allowed. Otherwise return the open connections of
        which one must be closed first.
        """
        if len(self._open) >= MOST:
            return self._open
        own = [one for one in self._open if one.client == client]
        return own if len(own) >= MOST_PER_CLIENT else []

    def _close(self, stranger: _Connection) -> bool:
        """Shut a connection down, and return whether the thread that serves it has closed it within ``CLOSING_S``."""
        stranger.leaving = True
        with suppress(OSError):  # the client has closed it already
            stranger.request.shutdown(socket.SHUT_RDWR)
        return self._changed.wait_for(lambda: stranger not in self._open, CLOSING_S)
