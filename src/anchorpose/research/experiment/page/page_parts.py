"""Make parts of the page as HTML: tables, claims, figures, and the PNG pictures of a folder with their captions.

All text that does not come from this module, such as captions, is escaped here.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.document import parse_json, read_text
from anchorpose.recording.regular_file import LARGEST_IMAGE, read_whole
from anchorpose.research.experiment.page.drawing import GROUND, INK, LINE, DrawnFigure
from anchorpose.research.experiment.page.tables import Table, Unit, format_estimate, format_number
from anchorpose.research.experiment.page.verdict import Answer, Claim, Verdict

PICTURES_FOLDER: Final = "pictures"
CAPTIONS_FILE: Final = "pictures.json"
SECTIONS: Final = {
    "matches": "One per cent of the matches (the paper’s “appearance” and “mesh”)",
    "tracked": "Tracked joints over the truth (“mhtjoints”)",
    "hypotheses": "Hypotheses (“hypothesis”)",
    "regions": "Bright and shadow regions",
    "other": "More pictures",
}
"""Title of each section of pictures, in the page's order. Pictures without a caption are in the section "other"."""

FILES_ONLY: Final = "match"
"""Section of pictures that are written as files only: on the page, these pictures, one per method, would triple the
page's size.
"""

REMEDY: Final = "write a list of objects with file, caption and section, or remove the file"


@dataclass(frozen=True, slots=True)
class PagePicture:
    """A PNG picture on the page."""

    section: str
    caption: str
    png_bytes: bytes


def read_pictures(folder: Path) -> list[PagePicture]:
    """Return the PNG files of ``folder / pictures`` in the order of their captions.

    Files without a caption follow in the order of their names. Pictures of the section ``FILES_ONLY`` are left out.
    Raises InputError if the captions cannot be read, or name a missing file or section.
    """
    place = folder / PICTURES_FOLDER
    captions = _captions(place / CAPTIONS_FILE)
    found = {path.name: path for path in sorted(place.glob("*.png"))} if place.is_dir() else {}
    for name, _, section in captions:
        if name not in found or section not in (*SECTIONS, FILES_ONLY):
            raise InputError(
                place / CAPTIONS_FILE, f"names '{name}' of section '{section}', which does not exist", REMEDY
            )
    named = {name for name, _, _ in captions}
    rest = [(name, Path(name).stem.replace("_", " "), "other") for name in found if name not in named]
    return [
        PagePicture(section, caption, read_whole(found[name], LARGEST_IMAGE, REMEDY))
        for name, caption, section in [*captions, *rest]
        if section != FILES_ONLY
    ]


def _captions(path: Path) -> list[tuple[str, str, str]]:
    if not path.is_file():
        return []
    try:
        entries: Any = parse_json(read_text(path))
        return [(str(entry["file"]), str(entry["caption"]), str(entry["section"])) for entry in entries]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(path, f"contains no captions ({type(error).__name__})", REMEDY) from None


SIGNS: Final = {
    Verdict.HOLDS: ("holds", "✓"),
    Verdict.IN_PART: ("part", "½"),
    Verdict.NOT: ("not", "✗"),
    Verdict.UNKNOWN: ("unknown", "?"),
}
"""CSS class and sign of each verdict. The sign is for readers who cannot see the colour."""


MOST_NAMED: Final = 3
"""Maximum number of comparisons with the answer no that a claim's short text lists. If more comparisons have this
answer, the text lists none of them.
"""


def table_html(table: Table, unfolded: bool = False) -> str:
    """Return a table as HTML, a row per method, intervals in brackets. unfolded: whether the rows are visible when the
    page is opened.
    """
    head = "".join(f"<th scope='col'>{escape(column.label)}</th>" for column in table.columns)
    values = {(row.method.key, row.column): row.value for row in table.rows}
    rows = []
    for method in table.methods:
        found = [values.get((method.key, column)) for column in table.columns]
        texts = [
            "" if one is None else format_estimate(one, column.unit)
            for one, column in zip(found, table.columns, strict=True)
        ]
        cells = "".join(f"<td>{escape(text)}</td>" for text in texts)
        rows.append(f"<tr><th scope='row'>{escape(method.title)}</th>{cells}</tr>")
    title = escape(table.title)
    note = f"{escape(table.note)} In brackets: 95 % intervals. File: tables/{escape(table.key)}.csv"
    return (
        f"<details{' open' if unfolded else ''}><summary>{title}</summary><p class='hint'>{note}</p>"
        f"<div class='scroll' tabindex='0' role='region' aria-label='{title}'>"
        f"<table><caption>{title}</caption><thead><tr><th scope='col'>method</th>{head}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div></details>"
    )


def text_table(caption: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of texts as HTML; the first cell of each row is the name of the row."""
    top = "".join(f"<th scope='col'>{escape(name)}</th>" for name in head)
    body = "".join(
        f"<tr><th scope='row'>{escape(row[0])}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in row[1:])}</tr>"
        for row in rows
    )
    return (
        f"<div class='scroll' tabindex='0' role='region' aria-label='{escape(caption)}'><table class='text'>"
        f"<caption>{escape(caption)}</caption><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def claims_html(claims: Sequence[Claim]) -> str:
    """Return the page's first table as HTML: each claim with its verdict, how it was judged, and every comparison."""
    rows = "".join(_claim_row(claim) for claim in claims)
    return (
        "<div class='scroll' tabindex='0' role='region' aria-label='Claims'><table class='text claims'><thead><tr>"
        "<th scope='col'>verdict</th><th scope='col'>claim</th><th scope='col'>figures</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )


def _claim_row(claim: Claim) -> str:
    kind, sign = SIGNS[claim.verdict]
    checks = "".join(f"<li class='{check.answer}'>{escape(check.text())}</li>" for check in claim.checks)
    context = "".join(f"<li>{escape(line)}</li>" for line in claim.context)
    more = f"<p class='hint'>For comparison:</p><ul>{context}</ul>" if context else ""
    return (
        f"<tr id='claim-{escape(claim.key)}'><th scope='row' class='verdict {kind}'><b aria-hidden='true'>{sign}</b>"
        f"{claim.verdict}</th><td>{escape(claim.text)}<br><span class='hint'>{escape(claim.place)}</span></td>"
        f"<td>{escape(_figures(claim))}<details><summary>How it was judged</summary>"
        f"<p class='hint'>{escape(claim.rule)}</p><ul>{checks}</ul>{more}</details></td></tr>"
    )


def _figures(claim: Claim) -> str:
    """Return a short text on a claim's comparisons: the number of comparisons with each answer, and the range of their
    values.

    If at most ``MOST_NAMED`` comparisons answer no, the text lists these comparisons.
    """
    checks = claim.checks
    if len(checks) < 2:
        return checks[0].text() if checks else "no data"
    answers = [check.answer for check in checks]
    count = ", ".join(f"{answers.count(answer)} {answer}" for answer in Answer if answer in answers)
    summary = f"{len(checks)} comparisons: {count}."
    known = sorted(check.value.mean for check in checks if np.isfinite(check.value.mean))
    if known and len({check.unit for check in checks}) == 1:
        unit = checks[0].unit
        after = {Unit.MM: " mm", Unit.SECONDS: " s"}.get(unit, "")
        summary += f" Between {format_number(known[0], unit)} and {format_number(known[-1], unit)}{after}."
    against = [check.text() for check in checks if check.answer is Answer.NO]
    return f"{summary} No: {'; '.join(against)}." if 0 < len(against) <= MOST_NAMED else summary


def drawing_html(picture: DrawnFigure) -> str:
    """Return a figure as part of the page, in the page's light or dark colours."""
    caption = escape(picture.caption)
    return (
        f"<figure class='drawing'><div class='scroll' tabindex='0' role='region' aria-label='{caption}'>"
        f"{inline_svg(picture)}</div><figcaption>{caption}</figcaption></figure>"
    )


def inline_svg(picture: DrawnFigure) -> str:
    """Return a figure's SVG as part of the page: without header and metadata, and with ids unique on the page."""
    svg = picture.svg[picture.svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r" font-family: [^;\"]*;", "", svg)  # the page sets the font; this makes the SVG a tenth shorter
    svg = re.sub(r"(\.\d\d)\d+", r"\1", svg)  # hundredths of a point are not visible
    svg = re.sub(r'\bid="', f'id="{picture.key}-', svg)
    svg = re.sub(r"url\(#", f"url(#{picture.key}-", svg)
    svg = re.sub(r'href="#', f'href="#{picture.key}-', svg)
    for colour, of_page in ((INK, "currentColor"), (GROUND, "var(--ground)"), (LINE, "var(--line)")):
        svg = svg.replace(colour, of_page)
    return svg.replace("<svg", '<svg role="img" aria-hidden="true"', 1)


def pictures_html(pictures: Sequence[PagePicture], sections: Sequence[str]) -> str:
    """Return the pictures of some sections as HTML, each section with its title; an empty text without pictures."""
    parts = []
    for section in sections:
        shown = "".join(_picture(picture) for picture in pictures if picture.section == section)
        if shown:
            parts.append(f"<h3>{escape(SECTIONS[section])}</h3><div class='pictures'>{shown}</div>")
    return "".join(parts)


def _picture(picture: PagePicture) -> str:
    encoded, caption = base64.b64encode(picture.png_bytes).decode("ascii"), escape(picture.caption)
    return (
        f"<figure><img alt='{caption}' loading='lazy' src='data:image/png;base64,{encoded}'>"
        f"<figcaption>{caption}</figcaption></figure>"
    )


def best_of(table: Table, column: str, keys: Sequence[str]) -> str | None:
    """Return the key of the method with the smallest mean in a column; None if no method has a value."""
    means = {key: table.value(key, column).mean for key in keys}
    known = {key: mean for key, mean in means.items() if np.isfinite(mean)}
    return min(known, key=lambda key: known[key]) if known else None
