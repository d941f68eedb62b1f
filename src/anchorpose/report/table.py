"""A table that scrolls by itself where a screen is narrow, reached by Tab and named to those who cannot see it."""

from __future__ import annotations

from collections.abc import Sequence

from anchorpose.report.words import escape


def table(title: str, head: Sequence[str], body: str, kind: str = "") -> str:
    """HTML. title: its caption and name; head: titles of the columns, both plain text. body: its tbody elements."""
    name = escape(title)
    titles = "".join(f"<th scope='col'>{escape(column)}</th>" for column in head)
    return (
        f"<div class='scroll' tabindex='0' role='region' aria-label='{name}'><table class='{kind}'>"
        f"<caption>{name}</caption><thead><tr>{titles}</tr></thead>{body}</table></div>"
    )


def row(name: str, cells: Sequence[str], meaning: str = "") -> str:
    """HTML. name: of the row, plain text; cells: HTML; meaning: told when the name is pointed at."""
    title = f" title='{escape(meaning)}'" if meaning else ""
    return f"<tr><th scope='row'{title}>{escape(name)}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def heading_row(heading: str, columns: int) -> str:
    """HTML: the name of the rows below it."""
    return f"<tr class='group'><th scope='rowgroup' colspan='{columns}'>{escape(heading)}</th></tr>"
