"""The files of the pages, read once: no part of an address ever becomes a path on the disk."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Final

KINDS: Final = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
VIEWER_PAGE: Final = "index.html"
LIVE_PAGE: Final = "live.html"


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
def content_policy(page: str) -> str:
    """What a page (by its name) may load: its own files, and the one inline script (the import map), allowed by its
    hash."""
    scripts = re.findall(rb"<script type=\"importmap\">(.*?)</script>", load_assets()[page].content, re.DOTALL)
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
