"""Pieces of the page as HTML: tables, claims, drawings. Everything that comes from outside is escaped here.

The pictures that stand beside the figures: PNG files of a folder, with captions.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
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
"""Titles, in the order of the page; "other" is what no caption names."""

FILES_ONLY: Final = "match"
"""The section of pictures that stay files: one of each method would make the page three times as large."""

REMEDY: Final = "write a list of objects with file, caption and section, or take the file away"


@dataclass(frozen=True, slots=True)
class PagePicture:
    """A PNG of the folder."""

    section: str
    caption: str
    png_bytes: bytes


def read_pictures(folder: Path) -> list[PagePicture]:
    """The PNG files of ``folder / pictures`` in the order of their captions, then those without by name.

    Raises InputError where the captions cannot be read or name what is not there.
    """
    place = folder / PICTURES_FOLDER
    captions = _captions(place / CAPTIONS_FILE)
    found = {path.name: path for path in sorted(place.glob("*.png"))} if place.is_dir() else {}
    for name, _, section in captions:
        if name not in found or section not in (*SECTIONS, FILES_ONLY):
            raise InputError(
                place / CAPTIONS_FILE, f"names '{name}' of section '{section}', which is not there", REMEDY
            )
    named = {name for name, _, _ in captions}
    rest = [(name, Path(name).stem.replace("_", " "), "other") for name in found if name not in named]
    return [
        PagePicture(section, caption, found[name].read_bytes())
        for name, caption, section in [*captions, *rest]
        if section != FILES_ONLY
    ]


def _captions(path: Path) -> list[tuple[str, str, str]]:
    if not path.is_file():
        return []
    try:
        entries: Any = json.loads(path.read_text(encoding="utf-8"))
        return [(str(entry["file"]), str(entry["caption"]), str(entry["section"])) for entry in entries]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(path, f"holds no captions ({type(error).__name__})", REMEDY) from None


SIGNS: Final = {
    Verdict.HOLDS: ("holds", "✓"),
    Verdict.IN_PART: ("part", "½"),
    Verdict.NOT: ("not", "✗"),
    Verdict.UNKNOWN: ("unknown", "?"),
}
"""Class and sign: the colour says nothing that the sign and the words do not."""


MOST_NAMED: Final = 3
"""Comparisons that are written out in the table of claims itself."""


def table_html(table: Table, unfolded: bool = False) -> str:
    """Methods down, columns across; intervals in brackets."""
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
    """Cells of words; the first of each row is its name."""
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
    """The table that the page begins with: verdict, claim, how it was judged and every comparison."""
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
    """What the comparisons say and between which figures they lie; those that say no, where they are few."""
    checks = claim.checks
    if len(checks) < 2:
        return checks[0].text() if checks else "no data"
    answers = [check.answer for check in checks]
    count = ", ".join(f"{answers.count(answer)} {answer}" for answer in Answer if answer in answers)
    said = f"{len(checks)} comparisons: {count}."
    known = sorted(check.value.mean for check in checks if np.isfinite(check.value.mean))
    if known and len({check.unit for check in checks}) == 1:
        unit = checks[0].unit
        after = {Unit.MM: " mm", Unit.SECONDS: " s"}.get(unit, "")
        said += f" Between {format_number(known[0], unit)} and {format_number(known[-1], unit)}{after}."
    against = [check.text() for check in checks if check.answer is Answer.NO]
    return f"{said} No: {'; '.join(against)}." if 0 < len(against) <= MOST_NAMED else said


def drawing_html(picture: DrawnFigure) -> str:
    """A figure as part of the page: its ink and ground are the page's, light or dark."""
    caption = escape(picture.caption)
    return (
        f"<figure class='drawing'><div class='scroll' tabindex='0' role='region' aria-label='{caption}'>"
        f"{inline_svg(picture)}</div><figcaption>{caption}</figcaption></figure>"
    )


def inline_svg(picture: DrawnFigure) -> str:
    """The drawing without what only a file needs; names are made its own, since all figures share the page."""
    svg = picture.svg[picture.svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r" font-family: [^;\"]*;", "", svg)  # the page's, a tenth of the drawing's length
    svg = re.sub(r"(\.\d\d)\d+", r"\1", svg)  # of a point: nobody sees less
    svg = re.sub(r'\bid="', f'id="{picture.key}-', svg)
    svg = re.sub(r"url\(#", f"url(#{picture.key}-", svg)
    svg = re.sub(r'href="#', f'href="#{picture.key}-', svg)
    for colour, of_page in ((INK, "currentColor"), (GROUND, "var(--ground)"), (LINE, "var(--line)")):
        svg = svg.replace(colour, of_page)
    return svg.replace("<svg", '<svg role="img" aria-hidden="true"', 1)


def pictures_html(pictures: Sequence[PagePicture], sections: Sequence[str]) -> str:
    """The pictures of some sections, each section with its title; nothing without any."""
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
    """The key of the method with the smallest mean in a column; None where none has one."""
    means = {key: table.value(key, column).mean for key in keys}
    known = {key: mean for key, mean in means.items() if np.isfinite(mean)}
    return min(known, key=lambda key: known[key]) if known else None
