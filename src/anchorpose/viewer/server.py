"""The small web server of the viewer: HTTP only, what is asked is answered by the ``Desk``.

The files of the page, read once: no part of an address ever becomes a path on the disk.

Who may ask: the page that this program opened, and nobody else.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import ipaddress
import json
import re
import secrets
import socket
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, Final
from urllib.parse import parse_qsl, urlsplit

from anchorpose.errors import AnchorposeError
from anchorpose.viewer.desk import JSON, Answer, Desk
from anchorpose.viewer.payloads import told

KINDS: Final = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
PAGE: Final = "index.html"


@dataclass(frozen=True, slots=True)
class Asset:
    """A file of the page as it is sent."""

    content: bytes
    kind: str


@cache
def load_assets() -> dict[str, Asset]:
    """By the name in the address."""
    return dict(_walk(resources.files("anchorpose.viewer").joinpath("static"), ""))


@cache
def content_policy() -> str:
    """What the page may load: its own files, and the one script in it (the import map), known by its hash."""
    page = load_assets()[PAGE].content
    scripts = re.findall(rb"<script type=\"importmap\">(.*?)</script>", page, re.DOTALL)
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(text).digest()).decode()}'" for text in scripts)
    return (
        f"default-src 'none'; script-src 'self' {hashes}; style-src 'self'; connect-src 'self'; img-src 'self'; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    )


def _walk(folder: Traversable, prefix: str) -> Iterator[tuple[str, Asset]]:
    for item in folder.iterdir():
        if item.is_dir():
            yield from _walk(item, f"{prefix}{item.name}/")
        elif item.name.rpartition(".")[2] in KINDS:
            yield f"{prefix}{item.name}", Asset(item.read_bytes(), KINDS[item.name.rpartition(".")[2]])


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


MOST_BYTES: Final = 64 * 1024  # of a request's body: a correction is some hundred
PATIENCE_S: Final = 120.0  # a browser that says nothing for so long is gone


class ViewerServer(ThreadingHTTPServer):
    """Listens from the beginning; ``serve_forever`` answers. ``address`` is what to open."""

    daemon_threads = True

    def __init__(self, desk: Desk, host: str, port: int) -> None:
        self.desk, self.host = desk, host  # before the rest: a place that cannot be had closes the server at once
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        super().__init__((host, port), _Handler)
        self.guard = Guard(new_token(), self.server_address[1], is_loopback(host))

    @property
    def address(self) -> str:
        """With the token, which every request must carry."""
        everywhere = self.host in ("", "0.0.0.0", "::")  # which is no address that can be opened
        name = socket.gethostname() if everywhere else self.host
        return f"http://{f'[{name}]' if ':' in name else name}:{self.guard.port}/{self.guard.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that hangs up in the middle (a tab was closed) is no error of ours."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

    def server_close(self) -> None:
        """Ends the work that is under way as well."""
        self.desk.worker.cancel()
        super().server_close()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = PATIENCE_S
    server: ViewerServer

    def do_GET(self) -> None:
        name = self._admitted()
        if name is None:
            return
        assets = load_assets()
        if (name or PAGE) in assets:
            asset = assets[name or PAGE]
            self._send(HTTPStatus.OK, Answer(asset.content, asset.kind))
            return
        query = dict(parse_qsl(urlsplit(self.path).query))
        self._answer(lambda: self.server.desk.ask(name, query))

    def do_POST(self) -> None:
        name = self._admitted()
        if name is None:
            return
        if not self.server.guard.comes_from_the_page(self._plain_headers()):
            self._refuse(HTTPStatus.FORBIDDEN, "Only the viewer's own page may change something.")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > MOST_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "This is no correction.")
            return
        text = self.rfile.read(int(length))
        self._answer(lambda: self.server.desk.tell(name, _object(text)))

    def _admitted(self) -> str | None:
        """What is asked for, once token and host are right; otherwise None, and the refusal has been sent."""
        name = self.server.guard.path_within(self.path)
        if name is None or not self.server.guard.host_is_ours(self._plain_headers()):
            self._refuse(HTTPStatus.FORBIDDEN, "Open the address that 'anchorpose view' printed.")
            return None
        return name

    def _answer(self, make: Any) -> None:
        try:
            answer = make()
        except KeyError:
            self._refuse(HTTPStatus.NOT_FOUND, "There is no such thing here.")
        except (AnchorposeError, ValueError, TypeError, OSError) as error:
            self._refuse(HTTPStatus.BAD_REQUEST, told(error))
        else:
            self._send(HTTPStatus.OK, answer)

    def _refuse(self, status: HTTPStatus, sentence: str) -> None:
        self.close_connection = True  # a body may not have been read
        self._send(status, Answer(json.dumps({"error": sentence}).encode(), JSON))

    def _send(self, status: HTTPStatus, answer: Answer) -> None:
        with suppress(ConnectionError):
            self.send_response(status)
            self.send_header("Content-Type", answer.kind)
            self.send_header("Content-Length", str(len(answer.content)))
            self.send_header("Cache-Control", "no-store")  # nothing of a patient stays in the browser
            self.send_header("Content-Security-Policy", content_policy())
            self.send_header("Referrer-Policy", "no-referrer")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Cross-Origin-Resource-Policy", "same-origin")
            if self.close_connection:
                self.send_header("Connection", "close")
            self.end_headers()
            self.wfile.write(answer.content)

    def _plain_headers(self) -> dict[str, str]:
        return {key: self.headers.get(key, "") for key in ("Host", "Origin", "Content-Type")}

    def log_message(self, format: str, *args: Any) -> None:
        """Silent: the address, with its token, belongs into no log."""


def _object(text: bytes) -> dict[str, Any]:
    value = json.loads(text)
    if not isinstance(value, dict):
        raise ValueError("this is no object")
    return value
