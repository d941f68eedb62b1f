"""The small web server of the viewer: HTTP, access and the files of the page; ``ViewerApi`` answers the requests.

The files are read once: no part of an address ever becomes a path on the disk. Only the page that this program opened
may send requests.
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
from anchorpose.recording.json_text import parse_json
from anchorpose.viewer.api import JSON, Response, ViewerApi
from anchorpose.viewer.payloads import describe_error

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
    """By their names in the address."""
    return dict(_walk(resources.files("anchorpose.viewer").joinpath("static"), ""))


@cache
def content_policy() -> str:
    """What the page may load: its own files, and the one inline script (the import map), allowed by its hash."""
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


MOST_BYTES: Final = 64 * 1024  # of a request's body: a correction has some hundred
PATIENCE_S: Final = 120.0  # a browser that sends nothing for this long is gone


class ViewerServer(ThreadingHTTPServer):
    """Listens once it is made; ``serve_forever`` answers. ``address`` is what to open."""

    daemon_threads = True

    def __init__(self, api: ViewerApi, host: str, port: int) -> None:
        self.api, self.host = api, host  # first: where nothing can listen, the server is closed at once
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        super().__init__((host, port), _Handler)
        self.guard = Guard(new_token(), self.server_address[1], is_loopback(host))

    @property
    def address(self) -> str:
        """With the token, which every request must carry."""
        everywhere = self.host in ("", "0.0.0.0", "::")  # none of which can be opened
        name = socket.gethostname() if everywhere else self.host
        return f"http://{f'[{name}]' if ':' in name else name}:{self.guard.port}/{self.guard.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Silent about a browser that disconnects (a tab was closed)."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

    def server_close(self) -> None:
        """Cancels the work under way as well."""
        self.api.worker.cancel()
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
            self._send(HTTPStatus.OK, Response(asset.content, asset.kind))
            return
        query = dict(parse_qsl(urlsplit(self.path).query))
        self._answer(lambda: self.server.api.get(name, query))

    def do_POST(self) -> None:
        name = self._admitted()
        if name is None:
            return
        if not self.server.guard.comes_from_the_page(self._plain_headers()):
            self._refuse(HTTPStatus.FORBIDDEN, "Only the viewer's own page may change something.")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > MOST_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "This is not a correction.")
            return
        text = self.rfile.read(int(length))
        self._answer(lambda: self.server.api.post(name, _object(text)))

    def _admitted(self) -> str | None:
        """The requested name where token and host are right; otherwise None, and a refusal has been sent."""
        name = self.server.guard.path_within(self.path)
        if name is None or not self.server.guard.host_is_ours(self._plain_headers()):
            self._refuse(HTTPStatus.FORBIDDEN, "Open the address that 'anchorpose view' printed.")
            return None
        return name

    def _answer(self, make: Any) -> None:
        try:
            response = make()
        except KeyError:
            self._refuse(HTTPStatus.NOT_FOUND, "There is nothing of this name here.")
        except (AnchorposeError, ValueError, TypeError, OSError) as error:
            self._refuse(HTTPStatus.BAD_REQUEST, describe_error(error))
        else:
            self._send(HTTPStatus.OK, response)

    def _refuse(self, status: HTTPStatus, sentence: str) -> None:
        self.close_connection = True  # a body may not have been read
        self._send(status, Response(json.dumps({"error": sentence}).encode(), JSON))

    def _send(self, status: HTTPStatus, response: Response) -> None:
        with suppress(ConnectionError):
            self.send_response(status)
            self.send_header("Content-Type", response.kind)
            self.send_header("Content-Length", str(len(response.content)))
            self.send_header("Cache-Control", "no-store")  # no data of a patient stays in the browser
            self.send_header("Content-Security-Policy", content_policy())
            self.send_header("Referrer-Policy", "no-referrer")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Cross-Origin-Resource-Policy", "same-origin")
            if self.close_connection:
                self.send_header("Connection", "close")
            self.end_headers()
            self.wfile.write(response.content)

    def _plain_headers(self) -> dict[str, str]:
        return {key: self.headers.get(key, "") for key in ("Host", "Origin", "Content-Type")}

    def log_message(self, format: str, *args: Any) -> None:
        """Silent: the address, with its token, must not be logged."""


def _object(text: bytes) -> dict[str, Any]:
    value = parse_json(text)
    if not isinstance(value, dict):
        raise ValueError("this is not a JSON object")
    return value
