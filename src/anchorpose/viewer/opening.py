"""Opens the page in the browser without telling the secret of its address to the other users of the computer."""

from __future__ import annotations

import tempfile
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path


@contextmanager
def opened_page(address: str) -> Iterator[None]:
    """The browser goes to ``address`` by way of a file that only this user can read, gone when the block ends.

    What a program is started with everybody on the computer can list, so the address itself must not be in it.
    """
    with tempfile.TemporaryDirectory(prefix="anchorpose-") as folder:  # nobody else may enter it
        page = Path(folder) / "viewer.html"
        page.touch(mode=0o600)
        page.write_text(_forwarding(address), encoding="utf-8")
        webbrowser.open(page.as_uri())
        yield


def _forwarding(address: str) -> str:
    place = escape(address)
    return (
        '<!DOCTYPE html>\n<html lang="en"><meta charset="utf-8"><meta name="referrer" content="no-referrer">\n'
        f'<meta http-equiv="refresh" content="0; url={place}"><title>anchorpose</title>\n'
        f'<p><a href="{place}">Open the viewer</a></p></html>\n'
    )
