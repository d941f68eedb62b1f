"""One self-contained page that shows what every stage made of a frame, and the pictures beside it."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from anchorpose.results.folder import write_text_whole
from anchorpose.results.web_page import fill_page

PAGE_FILE: Final = "index.html"
FACTS_FILE: Final = "inspect.json"
"""The same in numbers; also the mark by which a folder is known to be ours."""


@dataclass(frozen=True, slots=True)
class StagePicture:
    """One camera's picture of a stage."""

    camera: str
    png_bytes: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A stage: key for file names, title, one sentence; legend: (colour as web pages write it, meaning).

    missing: why there are no pictures, empty where there are.
    """

    key: str
    title: str
    caption: str
    legend: tuple[tuple[str, str], ...] = ()
    pictures: tuple[StagePicture, ...] = ()
    missing: str = ""


def write_inspection(
    folder: Path, title: str, sections: Sequence[Section], account: Sequence[str], facts: dict[str, Any]
) -> Path:
    """Writes each camera's pictures, inspect.json and index.html into an existing folder; returns the page's path.

    The pictures are ``<camera>/<number>_<stage>.png`` in the order of the stages; the page holds them all in itself.
    """
    for number, section in enumerate(sections, 1):
        for picture in section.pictures:
            (folder / picture.camera).mkdir(exist_ok=True)
            (folder / picture.camera / f"{number:02d}_{section.key}.png").write_bytes(picture.png_bytes)
    (folder / FACTS_FILE).write_text(json.dumps(facts, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    page = fill_page(
        "anchorpose.pages",
        "inspection_page.html",
        title,
        account="".join(f"<li>{html.escape(sentence)}</li>" for sentence in account),
        contents="".join(f"<li><a href='#{section.key}'>{html.escape(section.title)}</a></li>" for section in sections),
        sections="".join(_section(number, section) for number, section in enumerate(sections, 1)),
    )
    write_text_whole(folder / PAGE_FILE, page)
    return folder / PAGE_FILE


def _section(number: int, section: Section) -> str:
    legend = "".join(
        f"<li><i style='background:{colour}'></i>{html.escape(text)}</li>" for colour, text in section.legend
    )
    shown = f"<ul class='legend'>{legend}</ul>" if legend else ""
    pictures = "".join(_figure(section, picture) for picture in section.pictures)
    body = f"{shown}<div class='pictures'>{pictures}</div>" if pictures else ""
    missing = f"<p class='missing'>{html.escape(section.missing)}</p>" if section.missing else ""
    return (
        f"<section id='{section.key}'><h2>{number}. {html.escape(section.title)}</h2>"
        f"<p>{html.escape(section.caption)}</p>{missing}{body}</section>"
    )


def _figure(section: Section, picture: StagePicture) -> str:
    encoded = base64.b64encode(picture.png_bytes).decode("ascii")
    name = html.escape(picture.camera)
    return (
        f"<figure><img alt='{html.escape(section.title)}, camera {name}' loading='lazy' "
        f"src='data:image/png;base64,{encoded}'><figcaption>camera {name}</figcaption></figure>"
    )
