"""Figures of an experiment: which there are, that they are the same each time, and told apart without colour."""

import sys
import xml.etree.ElementTree as ElementTree

import pytest
from experiment_builder import ABLATED, METHODS, make_results

from anchorpose.errors import MissingPackage
from anchorpose.research.experiment.config import Scene
from anchorpose.research.experiment.page.figures import FIGURES, draw_all
from anchorpose.research.experiment.page.matching_tables import matching_tables, time_tables
from anchorpose.research.experiment.page.tables import Table
from anchorpose.research.experiment.page.tracking_tables import tracking_tables

PNG_HEAD = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def tables() -> list[Table]:
    results = make_results(
        recordings=2, scenes=dict.fromkeys((Scene.LOOSE, Scene.REAL, Scene.CLINIC), (METHODS[0], METHODS[-1], *ABLATED))
    )
    return [*tracking_tables(results), *matching_tables(results), *time_tables(results)]


@pytest.mark.thorough
def test_all_figures_are_drawn_from_a_whole_outcome(tables: list[Table]) -> None:
    pictures = draw_all(tables)
    assert [picture.key for picture in pictures] == [figure.key for figure in FIGURES]
    for picture in pictures:
        assert picture.png_bytes.startswith(PNG_HEAD)
        assert ElementTree.fromstring(picture.svg).tag.endswith("svg")
        assert "anchor" in picture.svg, "texts stay texts"


def test_without_matplotlib_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch, tables: list[Table]) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingPackage, match=r"anchorpose\[experiments\]"):
        draw_all(tables)
