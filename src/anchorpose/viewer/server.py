"""The small web server of the viewer: HTTP only, what is asked is answered by the ``Desk``."""

from __future__ import annotations

import json
import socket
import sys
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final
from urllib.parse import parse_qsl, urlsplit

from anchorpose.errors import AnchorposeError
from anchorpose.viewer.assets import PAGE, content_policy, load_assets
from anchorpose.viewer.desk import JSON, Answer, Desk
from anchorpose.viewer.guard import Guard, is_loopback, new_token
from anchorpose.viewer.told import told

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
