"""Figures of an experiment: which there are, that they are the same each time, and told apart without colour."""

from __future__ import annotations

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


def test_all_figures_are_drawn_from_a_whole_outcome(tables: list[Table]) -> None:
    pictures = draw_all(tables)
    assert [picture.key for picture in pictures] == [figure.key for figure in FIGURES]
    for picture in pictures:
        assert picture.png_bytes.startswith(PNG_HEAD)
        assert ElementTree.fromstring(picture.svg).tag.endswith("svg")
        assert "anchor" in picture.svg, "texts stay texts"


def test_the_same_tables_give_the_same_bytes_whatever_was_drawn_before(tables: list[Table]) -> None:
    few = [table for table in tables if table.key in ("result1", "times")]
    once = draw_all(few)
    draw_all([table for table in tables if table.key == "sd1"])
    assert draw_all(few) == once
    assert "<dc:date>" not in once[0].svg


def test_one_method_and_one_size_of_hole_are_enough(recwarn: pytest.WarningsRecorder) -> None:
    results = make_results(recordings=1, methods=METHODS[:1], holes_m=(0.0,))
    tables = [*tracking_tables(results), *matching_tables(results), *time_tables(results)]
    assert "result1" in [picture.key for picture in draw_all(tables)]
    assert [str(warning.message) for warning in recwarn] == []


def test_without_matplotlib_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch, tables: list[Table]) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingPackage, match=r"anchorpose\[experiments\]"):
        draw_all(tables)
