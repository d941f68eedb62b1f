"""The web server of the viewer; ``ViewerApi`` answers the requests."""

from __future__ import annotations

from typing import Any
from urllib.parse import parse_qsl, urlsplit

from anchorpose.viewer.api import ViewerApi
from anchorpose.viewer.guarded_server import GuardedHandler, GuardedServer
from anchorpose.viewer.page_files import VIEWER_PAGE
from anchorpose.viewer.responses import Response


class ViewerServer(GuardedServer):
    """See ``GuardedServer``."""

    page, program = VIEWER_PAGE, "anchorpose view"

    def __init__(self, api: ViewerApi, host: str, port: int) -> None:
        self.api = api  # first: where nothing can listen, the server is closed at once
        super().__init__(host, port, _Handler)

    def server_close(self) -> None:
        """Cancels the work under way as well."""
        self.api.worker.cancel()
        super().server_close()


class _Handler(GuardedHandler):
    server: ViewerServer

    def answer_get(self, name: str) -> None:
        query = dict(parse_qsl(urlsplit(self.path).query))
        self.answer(lambda: self.server.api.get(name, query))

    def answer_post(self, name: str, body: dict[str, Any]) -> Response:
        return self.server.api.post(name, body)
