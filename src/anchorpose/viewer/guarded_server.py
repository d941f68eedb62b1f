"""Provide a small web server that sends a page of this program and its data to permitted clients only, and open the
page in the browser.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import socket
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, ClassVar, Final

from anchorpose.errors import AnchorposeError, InputError
from anchorpose.recording.document import parse_json
from anchorpose.viewer.access import Connections, Guard, is_loopback, new_token

# bytes, maximum size of the content of a request; a reviewer's correction has some hundred bytes
MOST_BYTES: Final = 64 * 1024
# s; a connection over which no request comes for this time is closed; for its next request, the browser opens another
# connection
IDLE_S: Final = 20.0
# s; if a browser reads nothing of an answer for this time, it counts as disconnected, and the connection is closed
PATIENCE_S: Final = 120.0


BYTES: Final = "application/octet-stream"
JSON: Final = "application/json"

KINDS: Final = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
VIEWER_PAGE: Final = "index.html"
LIVE_PAGE: Final = "live.html"
RATING_PAGE: Final = "rate.html"


@dataclass(frozen=True, slots=True)
class Response:
    """The content of an answer to a request: bytes and their media type."""

    content: bytes
    kind: str


def json_response(value: Any) -> Response:
    """Return a JSON response; raises ValueError if a number is NaN, which JSON does not have."""
    return Response(json.dumps(value, allow_nan=False).encode(), JSON)


def describe_error(error: Exception) -> str:
    """Return a sentence that describes an error, for the user of the page. A file is given by its name without its
    folder, since the folder's name may contain the name of the patient.
    """
    if isinstance(error, InputError):
        return str(InputError(error.path.name, error.problem, error.remedy))
    if isinstance(error, OSError):
        name = Path(str(error.filename)).name if error.filename else "The computer"
        return f"{name}: {error.strerror or 'cannot be used'}."
    return str(error)


class GuardedServer(ThreadingHTTPServer):
    """A server that accepts connections as soon as the object exists, and answers requests while ``serve_forever``
    runs.

    address: the address to open in a browser; page: name of the page that this address shows; program: name of the
    command that printed the address, which the message to clients without the token states. Raises AnchorposeError if
    the server cannot listen on ``host`` and ``port``.
    """

    daemon_threads = True
    # Maximum number of connections that wait to be accepted. If more connections wait, a browser whose connection is
    # not accepted tries again after a second.
    request_queue_size = 128
    page: ClassVar[str]
    program: ClassVar[str]

    def __init__(self, host: str, port: int, handler: type[GuardedHandler]) -> None:
        if not host:
            raise AnchorposeError("--host is empty; give a name or an address of this machine, for example 127.0.0.1.")
        self.host, self.connections = host, Connections()
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            super().__init__((host, port), handler)
        except (OSError, OverflowError, TypeError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            sentence = f"Cannot listen on {host}, port {port} ({why}); choose another --host or --port."
            raise AnchorposeError(sentence) from None
        self.guard = Guard(new_token(), self.server_address[1], is_loopback(host))

    @property
    def address(self) -> str:
        """Return the address of the page. It contains the token (a secret text), which every request must contain."""
        everywhere = self.host in ("0.0.0.0", "::")  # addresses that a browser cannot open
        name = socket.gethostname() if everywhere else self.host
        return f"http://{f'[{name}]' if ':' in name else name}:{self.guard.port}/{self.guard.token}/"

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Return whether a new connection is allowed (``Connections.add``); if not, the base class closes it."""
        return self.connections.add(request, client_address[0])

    def close_request(self, request: Any) -> None:
        """Close a connection, and stop counting it among the open connections."""
        super().close_request(request)
        self.connections.remove(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report an error, unless a browser has disconnected, for instance because a tab was closed."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class GuardedHandler(BaseHTTPRequestHandler):
    """A handler of requests that sends the files of the page to clients that send the token. Subclasses answer requests
    for data in ``answer_get``.
    """

    protocol_version = "HTTP/1.1"
    server: GuardedServer

    def handle_one_request(self) -> None:
        """Handle the next request of a connection; close the connection if no request comes for ``IDLE_S``."""
        self.connection.settimeout(IDLE_S)
        super().handle_one_request()

    def do_GET(self) -> None:
        """Answer a GET request with the file of the page that has the requested name. If no file has this name,
        ``answer_get`` answers.
        """
        name = self.admitted()
        if name is None:
            return
        asset = load_assets().get(name or self.server.page)
        if asset is not None:
            self.send(HTTPStatus.OK, asset)
        else:
            self.answer_get(name)

    def answer_get(self, name: str) -> None:
        """Answer a request for data, that is, a request for a name that is not the name of a file of the page."""
        raise NotImplementedError

    def do_POST(self) -> None:
        """Answer a POST request, which changes data. Only the page itself may send such a request, and its content must
        be a JSON object.
        """
        name = self.admitted()
        if name is None:
            return
        if not self.server.guard.comes_from_the_page(self.plain_headers()):
            self.refuse(HTTPStatus.FORBIDDEN, "Only the page itself may change something.")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or len(length) > len(str(MOST_BYTES)) or int(length) > MOST_BYTES:
            self.refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "This is too long.")
            return
        text = self.rfile.read(int(length))
        self.answer(lambda: self.answer_post(name, _object(text)))

    def answer_post(self, name: str, body: dict[str, Any]) -> Response:
        """Make a change and return the response; raises the errors that ``answer`` handles."""
        raise KeyError(name)

    def answer(self, make: Callable[[], Response]) -> None:
        """Call ``make`` and send the response that it returns. If ``make`` raises KeyError, refuse the request as
        unknown; if it raises AnchorposeError, ValueError, TypeError or OSError, refuse the request with a sentence that
        describes the error.
        """
        try:
            response = make()
        except KeyError:
            self.refuse(HTTPStatus.NOT_FOUND, "There is nothing of this name here.")
        except (AnchorposeError, ValueError, TypeError, OSError) as error:
            self.refuse(HTTPStatus.BAD_REQUEST, describe_error(error))
        else:
            self.send(HTTPStatus.OK, response)

    def admitted(self) -> str | None:
        """Return the name that a request asks for (its path after the token) if token and host are correct; otherwise
        send a refusal and return None.
        """
        name = self.server.guard.path_within(self.path)
        if name is None or not self.server.guard.host_is_ours(self.plain_headers()):
            self.refuse(HTTPStatus.FORBIDDEN, f"Open the address that '{self.server.program}' printed.")
            return None
        self.server.connections.trust(self.connection)
        self.connection.settimeout(PATIENCE_S)
        return name

    def refuse(self, status: HTTPStatus, sentence: str) -> None:
        """Send a refusal with a sentence, and end the connection."""
        # otherwise, content of this request that was not read would be taken for the next request
        self.close_connection = True
        self.send(status, Response(json.dumps({"error": sentence}).encode(), JSON))

    def send(self, status: HTTPStatus, response: Response) -> None:
        """Send a response: headers and content."""
        with suppress(ConnectionError):
            self.send_head(status, response.kind, {"Content-Length": str(len(response.content))})
            self.wfile.write(response.content)

    def send_head(self, status: HTTPStatus, kind: str, more: Mapping[str, str]) -> None:
        """Send status and headers. more: further headers of this answer, in addition to the headers that every answer
        has.
        """
        self.send_response(status)
        self.send_header("Content-Type", kind)
        for name, value in more.items():
            self.send_header(name, value)
        self.send_header("Cache-Control", "no-store")  # no data of a patient may stay in the browser
        self.send_header("Content-Security-Policy", content_policy(self.server.page))
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def plain_headers(self) -> dict[str, str]:
        """Return the headers of the request that ``Guard`` checks."""
        return {key: self.headers.get(key, "") for key in ("Host", "Origin", "Content-Type")}

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: a log of requests would contain the token, which is part of every request's path and must stay
        secret.
        """


def _object(text: bytes) -> dict[str, Any]:
    value = parse_json(text)
    if not isinstance(value, dict):
        raise ValueError("this is not a JSON object")
    return value


@cache
def load_assets() -> dict[str, Response]:
    """Return the files of the pages, by the names under which the browser asks for them. All files are read in advance,
    so that no part of a requested address is ever used as a path on the disk.
    """
    return dict(_walk(resources.files("anchorpose.viewer").joinpath("static"), ""))


@cache
def content_policy(page: str) -> str:
    """Return the Content-Security-Policy header of a page, given by its name. The page may load files from this server,
    and one inline script (the import map), which is allowed by its hash.
    """
    scripts = re.findall(rb"<script type=\"importmap\">(.*?)</script>", load_assets()[page].content, re.DOTALL)
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(text).digest()).decode()}'" for text in scripts)
    return (
        f"default-src 'none'; script-src 'self' {hashes}; style-src 'self'; connect-src 'self'; img-src 'self'; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    )


def _walk(folder: Traversable, prefix: str) -> Iterator[tuple[str, Response]]:
    for item in folder.iterdir():
        if item.is_dir():
            yield from _walk(item, f"{prefix}{item.name}/")
        elif item.name.rpartition(".")[2] in KINDS:
            yield f"{prefix}{item.name}", Response(item.read_bytes(), KINDS[item.name.rpartition(".")[2]])


@contextmanager
def opened_page(address: str) -> Iterator[None]:
    """Open ``address`` in the browser through a file that only this user can read, deleted when the block ends.

    Every user of the computer can list the arguments with which programs were started, so the secret address must not
    be an argument of the browser.
    """
    with tempfile.TemporaryDirectory(prefix="anchorpose-") as folder:  # only this user may open this folder
        page = Path(folder) / "page.html"
        page.touch(mode=0o600)
        page.write_text(_forwarding(address), encoding="utf-8")
        webbrowser.open(page.as_uri())
        yield


def _forwarding(address: str) -> str:
    place = escape(address)
    return (
        '<!DOCTYPE html>\n<html lang="en"><meta charset="utf-8"><meta name="referrer" content="no-referrer">\n'
        f'<meta http-equiv="refresh" content="0; url={place}"><title>anchorpose</title>\n'
        f'<p><a href="{place}">Open the page</a></p></html>\n'
    )
