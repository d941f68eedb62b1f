"""Everything that a reader sees of an experiment, written from its outcome alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from anchorpose.experiments.outcome import Outcome
from anchorpose.experiments.presentation.claims import claims_json, judge_claims
from anchorpose.experiments.presentation.figures.drawing import Picture
from anchorpose.experiments.presentation.figures.gallery import draw_all
from anchorpose.experiments.presentation.matching_tables import matching_tables
from anchorpose.experiments.presentation.page import compose_page
from anchorpose.experiments.presentation.setting_table import SETTINGS_KEY, settings_csv
from anchorpose.experiments.presentation.shown_pictures import read_pictures
from anchorpose.experiments.presentation.tables import Table, csv_text
from anchorpose.experiments.presentation.time_tables import time_tables
from anchorpose.experiments.presentation.tracking_tables import tracking_tables
from anchorpose.results.folder import whole_or_nothing, write_text_whole

TABLES_FOLDER: Final = "tables"
FIGURES_FOLDER: Final = "figures"
CLAIMS_FILE: Final = "claims.json"
PAGE_FILE: Final = "index.html"


def write_outcome(outcome: Outcome, out: Path) -> None:
    """tables/*.csv, figures/*.svg and *.png, claims.json and index.html in ``out``; the same outcome, the same bytes.

    What is there of these is replaced, each folder and file as a whole and the page last; nothing else is touched.
    The page shows the pictures of ``out / pictures``. Raises MissingPackage without matplotlib and InputError for
    captions that cannot be used, both before anything is written.
    """
    tables = [*tracking_tables(outcome), *matching_tables(outcome), *time_tables(outcome)]
    claims, figures, shown = judge_claims(outcome), draw_all(tables), read_pictures(out)
    page = compose_page(outcome, tables, claims, figures, shown)
    _write_tables(tables, outcome, out / TABLES_FOLDER)
    _write_figures(figures, out / FIGURES_FOLDER)
    write_text_whole(out / CLAIMS_FILE, claims_json(claims))
    write_text_whole(out / PAGE_FILE, page)


def _write_tables(tables: Sequence[Table], outcome: Outcome, folder: Path) -> None:
    with whole_or_nothing(folder) as partial:
        for table in tables:
            (partial / f"{table.key}.csv").write_text(csv_text(table), encoding="utf-8")
        (partial / f"{SETTINGS_KEY}.csv").write_text(settings_csv(outcome), encoding="utf-8")


def _write_figures(figures: Sequence[Picture], folder: Path) -> None:
    with whole_or_nothing(folder) as partial:
        for figure in figures:
            (partial / f"{figure.key}.svg").write_text(figure.svg, encoding="utf-8")
            (partial / f"{figure.key}.png").write_bytes(figure.png_bytes)
