"""Pages that hold all they need in themselves: a template each, and the one head that all of them have."""

from __future__ import annotations

import html
from importlib import resources
from string import Template
from typing import Final

HEAD_FILE: Final = "page_head.html"


def fill_page(package: str, template: str, title: str, **parts: str) -> str:
    """The template, a file of the package, with its ``$head``, ``$title`` and the other parts, which are HTML already.

    title: as people read it; it is escaped here.
    """
    escaped = html.escape(title)
    head = _read("anchorpose.results", HEAD_FILE).substitute(title=escaped)
    return _read(package, template).substitute(head=head, title=escaped, **parts)


def _read(package: str, name: str) -> Template:
    return Template(resources.files(package).joinpath(name).read_text(encoding="utf-8"))
