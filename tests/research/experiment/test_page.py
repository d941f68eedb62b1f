"""The page and the folder: everything is there, nothing is loaded from elsewhere, nothing is taken for HTML."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from experiment_builder import ABLATED, METHODS, make_results, method
from page_reader import PageReader

from anchorpose.errors import InputError
from anchorpose.research.experiment.config import Scene
from anchorpose.research.experiment.method import Family
from anchorpose.research.experiment.page import page as publish
from anchorpose.research.experiment.page.drawing import DrawnFigure
from anchorpose.research.experiment.page.figures import draw_all
from anchorpose.research.experiment.page.page import write_results
from anchorpose.research.experiment.page.page_parts import read_pictures
from anchorpose.research.experiment.page.tables import Table
from anchorpose.research.experiment.results import ExperimentResults, TriedSetting

EVIL = "<script>alert('&')</script>"
PNG = b"\x89PNG\r\n\x1a\nnot much of a picture"


@pytest.fixture(scope="module")
def results() -> ExperimentResults:
    made = make_results(recordings=2, scenes={Scene.CLINIC: (METHODS[0], METHODS[-1], *ABLATED)})
    evil = method("evil", EVIL, Family.LOCAL)
    settings = (*made.tried, ("evil", (TriedSetting(EVIL, 1.0, True),)))
    return replace(made, methods=(*made.methods, evil), tried=settings, failed=(f"paper-7: {EVIL}",))


@pytest.fixture(scope="module")
def figures() -> list[DrawnFigure]:
    """What ``folder`` holds; filled when it is written."""
    return []


@pytest.fixture(scope="module")
def folder(results: ExperimentResults, figures: list[DrawnFigure], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out: Path = tmp_path_factory.mktemp("experiment")
    (out / "pictures").mkdir()
    (out / "pictures" / "fpfh.png").write_bytes(PNG)
    (out / "pictures" / "loose_end.png").write_bytes(PNG)
    (out / "pictures" / "alone.png").write_bytes(PNG)
    captions = [
        {"file": "fpfh.png", "caption": f"FPFH {EVIL}", "section": "matches"},
        {"file": "alone.png", "caption": "one method by itself", "section": "match"},
    ]
    (out / "pictures" / "pictures.json").write_text(json.dumps(captions))
    (out / "figures").mkdir()
    (out / "figures" / "notes.txt").write_text("mine")
    (out / "cache").mkdir()
    (out / "cache" / "kept").write_text("as it was")

    def draw(tables: Sequence[Table]) -> list[DrawnFigure]:
        figures.extend(draw_all(tables))
        return figures

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(publish, "draw_all", draw)
        write_results(results, out)
    return out


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return (folder / "index.html").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_files_that_are_not_the_experiments_are_kept(folder: Path) -> None:
    assert (folder / "figures.kept" / "notes.txt").read_text() == "mine"
    assert (folder / "cache" / "kept").read_text() == "as it was"


def test_the_page_is_well_formed_and_loads_nothing(folder: Path, page: str) -> None:
    elements = PageReader(folder / "index.html").elements
    ids = [element.attributes["id"] for element in elements if "id" in element.attributes]
    links = {element.attributes["href"].removeprefix("#") for element in elements if element.tag == "a"}
    assert len(set(ids)) == len(ids)
    assert all(e.attributes.get("src", "data:image/png;base64,").startswith("data:image/png;base64,") for e in elements)
    assert links <= set(ids)
    assert not re.search(r"url\((?!#)|@import|<link|<script", page)


@pytest.mark.thorough
def test_nothing_from_outside_is_taken_for_html(page: str) -> None:
    assert EVIL not in page
    assert page.count("&lt;script&gt;") >= 4  # the method, its setting, the failed recording, the caption


@pytest.mark.thorough
def test_the_config_on_the_page_is_what_the_command_reads(
    page: str, results: ExperimentResults, tmp_path: Path
) -> None:
    import html

    from anchorpose.recording.document import load_config

    text = html.unescape(re.findall(r"<pre>(.*?)</pre>", page, re.DOTALL)[1])
    (tmp_path / "experiment.toml").write_text(text)
    assert load_config(tmp_path / "experiment.toml", type(results.config)) == results.config


def test_an_empty_outcome_is_a_page_that_says_so(tmp_path: Path) -> None:
    empty = replace(make_results(recordings=1), tracked=(), matched=(), times=None, tried=())
    write_results(empty, tmp_path)
    PageReader(tmp_path / "index.html")
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "20 undecided" in text
    assert "nothing of this was run" in text


@pytest.mark.parametrize(
    "captions",
    [
        "{",
        '[{"file": "a.png"}]',
        '["a.png"]',
        '{"file": "a.png"}',
        '[{"file": "../a.png", "caption": "", "section": "matches"}]',
        '[{"file": "a.png", "caption": "", "section": "elsewhere"}]',
        '[{"file": "missing.png", "caption": "", "section": "matches"}]',
    ],
)
def test_captions_that_cannot_be_used_are_refused_before_anything_is_written(captions: str, tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    (tmp_path / "a.png").write_bytes(PNG)
    (tmp_path / "pictures" / "a.png").write_bytes(PNG)
    (tmp_path / "pictures" / "pictures.json").write_text(captions)
    with pytest.raises(InputError, match=r"pictures\.json"):
        read_pictures(tmp_path)
