"""index.html: one page that says what was run, what became of each claim, and shows every figure and table."""

from __future__ import annotations

from collections.abc import Sequence

from anchorpose.experiments.outcome import Outcome
from anchorpose.experiments.presentation.figures.drawing import Picture
from anchorpose.experiments.presentation.page_parts import (
    claims_html,
    drawing_html,
    pictures_html,
    table_html,
    text_table,
)
from anchorpose.experiments.presentation.page_text import again_html, limits_html, run_html, summary_html
from anchorpose.experiments.presentation.shown_pictures import ShownPicture
from anchorpose.experiments.presentation.tables import Table
from anchorpose.experiments.presentation.time_tables import paper_time_lines
from anchorpose.experiments.presentation.tracking_tables import OTHER_HOLES
from anchorpose.experiments.presentation.verdict import Claim
from anchorpose.results.web_page import fill_page

NO_DATA = "<p class='hint'>Nothing was run that this could be told from.</p>"

UNFOLDED = ("result1_same_frames", "matching", "times", "scenes_same_frames", "ablation")
"""Tables that are open from the start."""

MORE = tuple(f"{scene}_by_size" for scene in OTHER_HOLES)


def compose_page(
    outcome: Outcome,
    tables: Sequence[Table],
    claims: Sequence[Claim],
    figures: Sequence[Picture],
    shown: Sequence[ShownPicture],
) -> str:
    """The whole page, which needs nothing beside it; the same input gives the same text."""

    def part(drawn: Sequence[str], listed: Sequence[str], pictures: Sequence[str] = ()) -> str:
        images = [drawing_html(figure) for key in drawn for figure in figures if figure.key == key]
        rows = [table_html(table, table.key in UNFOLDED) for table in tables if _root(table) in listed]
        return "".join([*images, pictures_html(shown, pictures), *rows]) or NO_DATA

    return fill_page(
        "anchorpose.experiments.presentation",
        "page.html",
        "The paper’s experiment, repeated",
        summary=summary_html(outcome, claims, tables),
        claims=claims_html(claims),
        run=run_html(outcome),
        tracking=part(
            ("result1", "sd1", "ratio", "result2", "sd2"),
            ("result1", "sd1", "result1_occluded", "known", "ratio", "ratio_occluded", "result2", "sd2"),
            ("tracked", "hypotheses", "regions"),
        ),
        matching=part(
            ("matching", "princeton"),
            ("matching", "matching_by_region", "mirrored_by_region", "matching_by_size", "matching_by_size_tree",
             "princeton_mm", "princeton_height"),
            ("matches",),
        ),
        times=_paper_times(outcome) + part(("times",), ("times",)),
        more=part(("scenes", *MORE, "ablation"), ("scenes", *MORE, "ablation"), ("other",)),
        limits=limits_html(outcome),
        again=again_html(outcome),
    )  # fmt: skip


def _root(table: Table) -> str:
    return table.key.removesuffix("_all_frames").removesuffix("_same_frames")


def _paper_times(outcome: Outcome) -> str:
    if outcome.times is None:
        return ""
    caption = "A mesh at every pixel and its five distance fields, on one core"
    return text_table(caption, ("what", "here", "paper (i7-6700)"), paper_time_lines(outcome.times))
