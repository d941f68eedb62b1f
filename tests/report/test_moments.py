"""Moments that the body does not explain: a sentence, a table, a row of the timeline; nothing where there are none."""

from pathlib import Path

import numpy as np
import pytest
from page_reader import PageReader
from report_builder import RATE_HZ, squats, write_session
from results_builder import explained_frames, write_explained_frames

from anchorpose.errors import InputError
from anchorpose.report.page import write_report
from anchorpose.report.session import read_session
from anchorpose.report.summary import moment_section
from anchorpose.results.explained import ExplainedFrame

FRAMES = 120


def explained(bare: dict[int, float], past: dict[tuple[int, str], float]) -> list[ExplainedFrame]:
    area = np.full(FRAMES, 5.0)
    area[list(bare)] = list(bare.values())
    area[100:] = np.nan  # the patient is lost
    return explained_frames(area.tolist(), past, RATE_HZ)


def page_of(folder: Path, frames: list[ExplainedFrame]) -> PageReader:
    write_session(folder, squats(FRAMES))
    if frames:
        write_explained_frames(folder, frames)
    return PageReader(write_report(folder))


def section(page: PageReader) -> str:
    return next(element.text for element in page.find("section", id="moments"))


def test_the_sentence_and_the_table_name_the_worst_moments(tmp_path: Path) -> None:
    past = {(10, "arm_left"): 0.45, (40, "leg_right"): 0.62, (40, "trunk"): 0.31}
    page = page_of(tmp_path / "r", explained({10: 620.0, 11: 610.0, 60: 100.0}, past))
    assert "In 3 % of the frames in which the patient was found" in section(page)  # of 100 and not of 120
    assert "80 cm² or more of the patient's visible surface is covered by no limb" in section(page)
    table = page.find("section", id="moments")[0]
    rows = [row.text for row in page.find("tr") if table in row.ancestors]
    assert rows[1].startswith("0.33 s10620 cm²left arm 45 %")
    assert rows[2].startswith("1.33 s405 cm²trunk 31 % and right leg 62 %")
    assert rows[3].startswith("2.00 s60100 cm²none")
    assert len(rows) == 4
    assert "not explained by the body" in next(each.text for each in page.find("section", id="time"))
    assert "#moments" in [link.attributes.get("href") for link in page.find("a")]


@pytest.mark.parametrize("frames", [[], explained({}, {})], ids=["older results", "all explained"])
def test_without_such_moments_the_page_says_nothing_of_them(tmp_path: Path, frames: list[ExplainedFrame]) -> None:
    page = page_of(tmp_path / "r", frames)
    assert page.find("section", id="moments") == []
    assert "not explained" not in " ".join(element.text for element in page.find("section"))
    assert "#moments" not in [link.attributes.get("href") for link in page.find("a")]
    assert moment_section(read_session(tmp_path / "r")) is None


def test_a_table_of_other_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"explained\.parquet: has other frames"):
        page_of(tmp_path / "r", explained({}, {})[:-1])
