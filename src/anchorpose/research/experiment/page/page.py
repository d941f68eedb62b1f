"""Write the files that present an experiment's results: tables, figures, claims, and index.html with all of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from markupsafe import Markup

from anchorpose.report.words import render_page
from anchorpose.research.experiment.page.drawing import DrawnFigure
from anchorpose.research.experiment.page.figures import draw_all
from anchorpose.research.experiment.page.form_tables import form_tables
from anchorpose.research.experiment.page.matching_claims import MatchingClaims, paper_times
from anchorpose.research.experiment.page.matching_tables import matching_tables, paper_time_lines, time_tables
from anchorpose.research.experiment.page.page_parts import (
    PagePicture,
    claims_html,
    drawing_html,
    pictures_html,
    read_pictures,
    table_html,
    text_table,
)
from anchorpose.research.experiment.page.page_text import (
    SETTINGS_KEY,
    again_html,
    limits_html,
    run_html,
    settings_csv,
    summary_html,
)
from anchorpose.research.experiment.page.tables import Table, csv_text
from anchorpose.research.experiment.page.tracking_claims import TrackingClaims, literal_claims
from anchorpose.research.experiment.page.tracking_tables import OTHER_HOLES, tracking_tables
from anchorpose.research.experiment.page.verdict import Claim, claims_json
from anchorpose.research.experiment.results import ExperimentResults
from anchorpose.results.folder import whole_or_nothing, write_text_whole

NO_DATA = "<p class='hint'>No data: nothing of this was run.</p>"

UNFOLDED = (
    "result1",
    "result1_all",
    "forms",
    "forms_body",
    "next_joints",
    "gaps_within",
    "moved_within",
    "matching",
    "times",
    "scenes",
    "ablation",
)
"""Keys of the tables whose rows are visible when the page is opened; all other tables are folded."""

MORE = tuple(f"{scene}_by_size" for scene in OTHER_HOLES)


def judge_claims(results: ExperimentResults) -> list[Claim]:
    """Return all claims with their verdicts; claims about joints come first."""
    of_joints = [*TrackingClaims(results).all(), *literal_claims(results)]
    return [*of_joints, *MatchingClaims(results).all(), paper_times(results)]


def compose_page(
    results: ExperimentResults,
    tables: Sequence[Table],
    claims: Sequence[Claim],
    figures: Sequence[DrawnFigure],
    shown: Sequence[PagePicture],
) -> str:
    """Return the whole page as HTML, which needs no other files; the same input gives the same text."""

    def part(drawn: Sequence[str], listed: Sequence[str], pictures: Sequence[str] = ()) -> str:
        images = [drawing_html(figure) for key in drawn for figure in figures if figure.key == key]
        rows = [table_html(table, table.key in UNFOLDED) for table in tables if table.key in listed]
        return "".join([*images, pictures_html(shown, pictures), *rows]) or NO_DATA

    parts = {
        "summary": summary_html(results, claims, tables),
        "claims": claims_html(claims),
        "run": run_html(results),
        "tracking": part(
            ("result1", "sd1", "ratio", "result2", "sd2"),
            (
                "result1",
                "result1_all",
                "median",
                "body",
                "sd1",
                "result1_occluded",
                "known",
                "ratio",
                "ratio_occluded",
                "result2",
                "sd2",
            ),
            ("tracked", "hypotheses", "regions"),
        ),
        "forms": part((), ("forms", "forms_median", "forms_body", "next_joints", "next_body")),
        "gaps": part(
            (),
            (
                "gaps_within",
                "gaps_median",
                "gaps_mean",
                "moved_within",
                "moved_median",
                "moved_mean",
                "next_matches",
                "next_matches_rejected",
                "next_matches_moved",
            ),
        ),
        "matching": part(
            ("matching", "princeton"),
            (
                "matching",
                "matching_by_region",
                "mirrored_by_region",
                "matching_by_size",
                "matching_by_size_tree",
                "princeton_mm",
                "princeton_height",
            ),
            ("matches",),
        ),
        "times": _paper_times(results) + part(("times",), ("times",)),
        "more": part(("scenes", *MORE, "ablation"), ("scenes", *MORE, "ablation"), ("other",)),
        "limits": limits_html(results),
        "again": again_html(results),
    }
    title = "The paper’s experiment, repeated"
    package = "anchorpose.research.experiment.page"
    return render_page(package, "page.html", title=title, **{name: Markup(html) for name, html in parts.items()})


def _paper_times(results: ExperimentResults) -> str:
    if results.times is None:
        return ""
    caption = "A mesh at every pixel and its five distance fields, on one core"
    return text_table(caption, ("what", "here", "paper (i7-6700)"), paper_time_lines(results.times))


TABLES_FOLDER: Final = "tables"
FIGURES_FOLDER: Final = "figures"
CLAIMS_FILE: Final = "claims.json"
PAGE_FILE: Final = "index.html"


def write_results(results: ExperimentResults, out: Path) -> None:
    """Write tables/*.csv, figures/*.svg and *.png, claims.json and index.html into ``out``.

    The same results give the same bytes. Existing folders and files of these names are replaced as a whole (the page
    last); other files are not changed. The page shows the pictures in ``out / pictures``. Raises MissingPackage without
    matplotlib and InputError for unusable captions, both before anything is written.
    """
    tables = [*tracking_tables(results), *form_tables(results), *matching_tables(results), *time_tables(results)]
    claims, figures, shown = judge_claims(results), draw_all(tables), read_pictures(out)
    page = compose_page(results, tables, claims, figures, shown)
    _write_tables(tables, results, out / TABLES_FOLDER)
    _write_figures(figures, out / FIGURES_FOLDER)
    write_text_whole(out / CLAIMS_FILE, claims_json(claims))
    write_text_whole(out / PAGE_FILE, page)


def _write_tables(tables: Sequence[Table], results: ExperimentResults, folder: Path) -> None:
    with whole_or_nothing(folder, ("*.csv",)) as partial:
        for table in tables:
            (partial / f"{table.key}.csv").write_text(csv_text(table), encoding="utf-8")
        (partial / f"{SETTINGS_KEY}.csv").write_text(settings_csv(results), encoding="utf-8")


def _write_figures(figures: Sequence[DrawnFigure], folder: Path) -> None:
    with whole_or_nothing(folder, ("*.svg", "*.png")) as partial:
        for figure in figures:
            (partial / f"{figure.key}.svg").write_text(figure.svg, encoding="utf-8")
            (partial / f"{figure.key}.png").write_bytes(figure.png_bytes)
