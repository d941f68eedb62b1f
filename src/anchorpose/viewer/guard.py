"""Who may ask: the page that this program opened, and nobody else."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

TOKEN_BYTES = 24


@dataclass(frozen=True, slots=True)
class Guard:
    """The token is the first part of every path. On loopback the Host must be a loopback name as well: another site
    that points its name here (DNS rebinding) says its own. What changes something must come from the page."""

    token: str
    port: int
    loopback: bool

    def path_within(self, path: str) -> str | None:
        """What stands behind the token in a request's path, without the query; None where the token is not there."""
        first, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
        return rest if hmac.compare_digest(first.encode(), self.token.encode()) else None

    def host_is_ours(self, headers: Mapping[str, str]) -> bool:
        """Whether the request was made to a name that stands for this machine; whichever port, since that of a tunnel's
        other end is another."""
        return not self.loopback or is_loopback(_name_in(headers.get("Host", "")))

    def comes_from_the_page(self, headers: Mapping[str, str]) -> bool:
        """Whether a request that changes something was made by our page: browsers name the origin, and JSON cannot be
        sent from elsewhere without asking first."""
        origin, host = headers.get("Origin"), headers.get("Host", "")
        return headers.get("Content-Type", "") == "application/json" and origin == f"http://{host}"


def new_token() -> str:
    """A token that cannot be guessed, of letters that may stand in an address."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def _name_in(host: str) -> str:
    """What a Host header says without its port; empty where it makes no sense."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def is_loopback(host: str) -> bool:
    """Whether nobody but this machine can reach the address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
