"""From a results folder to the viewer's page in the browser."""

from __future__ import annotations

import tempfile
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path

from anchorpose.errors import InputError
from anchorpose.results.corrections import corrections_beside, corrections_of_run
from anchorpose.results.run_record import RUN_FILE
from anchorpose.viewer.api import ViewerApi
from anchorpose.viewer.correction_file import CorrectionFile
from anchorpose.viewer.review import open_review
from anchorpose.viewer.server import ViewerServer


def open_viewer(
    results: Path, recording: Path | None, corrections: Path | None, who: str, host: str, port: int
) -> ViewerServer:
    """A server that listens.

    corrections: the file to extend; None = beside the results (``corrections_beside``). A new file begins with the
    corrections that the results were tracked with. Raises InputError where results, recording or corrections cannot be
    used, AnchorposeError where it cannot listen on ``host`` and ``port``.
    """
    if not results.is_dir():
        raise InputError(results, "there is no such folder", "give a results folder made by 'anchorpose track'")
    review = open_review(results, recording)
    path = corrections if corrections is not None else corrections_beside(results)
    initial = corrections_of_run(results / RUN_FILE, review.run)
    api = ViewerApi(review, CorrectionFile(path, initial, review.joints), who)
    return ViewerServer(api, host, port)


@contextmanager
def opened_page(address: str) -> Iterator[None]:
    """Opens ``address`` in the browser through a file that only this user can read, deleted when the block ends.

    Every user of the computer can list the arguments of programs, so the secret address must not be one of them.
    """
    with tempfile.TemporaryDirectory(prefix="anchorpose-") as folder:  # only this user may enter it
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
