"""Who may send requests to a page's server: only the page that this program opened."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

TOKEN_BYTES: Final = 24


@dataclass(frozen=True, slots=True)
class Guard:
    """Which requests are served: the token must be the first part of every path.

    On loopback the Host must be a loopback name as well: another site that points its name here (DNS rebinding) sends
    its own. A request that changes something must come from the page.
    """

    token: str
    port: int
    loopback: bool

    def path_within(self, path: str) -> str | None:
        """The rest of a request's path after the token, without the query; None where the token is missing."""
        first, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
        return rest if hmac.compare_digest(first.encode(), self.token.encode()) else None

    def host_is_ours(self, headers: Mapping[str, str]) -> bool:
        """Whether the request was made to a name of this machine; on any port, since the other end of a tunnel has
        another one."""
        return not self.loopback or is_loopback(_name_in(headers.get("Host", "")))

    def comes_from_the_page(self, headers: Mapping[str, str]) -> bool:
        """Whether a request that changes something was made by our page: browsers name the origin, and pages from
        elsewhere cannot send JSON without a preflight request."""
        origin, host = headers.get("Origin"), headers.get("Host", "")
        return headers.get("Content-Type", "") == "application/json" and origin == f"http://{host}"


def new_token() -> str:
    """A token that cannot be guessed, of characters that are valid in an address."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def _name_in(host: str) -> str:
    """The name in a Host header without its port; empty where it is malformed."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
