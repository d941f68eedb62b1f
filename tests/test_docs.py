"""The documentation builds without a warning, its links lead somewhere, and its examples run."""

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from results_builder import make_frame, standing_joints, write_results

import anchorpose
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.tables import read_joints, write_angles
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
ALONE = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


def run(*command: str | Path) -> str:
    done = subprocess.run(
        [sys.executable, *map(str, command)], env=ALONE, capture_output=True, text=True, check=False, timeout=240
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The built pages; any warning is an error."""
    pytest.importorskip("sphinx")
    folder = tmp_path_factory.mktemp("docs")
    run("-m", "sphinx", "-q", "-W", "--keep-going", ROOT / "docs", folder / "site", "-d", folder / "trees")
    return folder / "site"


@pytest.mark.thorough
def test_the_documentation_holds_the_api_and_the_examples(site):
    api = (site / "api.html").read_text(encoding="utf-8")
    assert "anchorpose.pipeline.track_recording" in api
    assert [name for name in anchorpose.__all__ if not re.search(rf'id="anchorpose[\w.]*\.{name}"', api)] == []
    assert "truth.npz" in (site / "examples.html").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_nobody_has_to_fetch_anything_to_read_it(site):
    page = (site / "index.html").read_text(encoding="utf-8")
    assert [tag for tag in page.split("<") if tag.startswith(("script", "link", "img")) and "//" in tag] == []


@pytest.mark.slow
def test_a_simulated_patient_is_tracked(tmp_path):
    told = run(EXAMPLES / "track_a_simulated_patient.py", tmp_path, "--seconds", "1")
    assert "joints are" in told
    assert told.count("degrees off") == 2


def test_knee_angles_become_a_picture(tmp_path):
    results = write_results(tmp_path / "r", [make_frame(i, i / 10, standing_joints()) for i in range(5)])
    write_angles(results / "angles.parquet", joint_angles(read_joints(results / "joints.parquet")))
    run(EXAMPLES / "plot_knee_angles.py", results, tmp_path / "knees.png")
    assert (tmp_path / "knees.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_geodesics_of_one_picture_are_printed(tmp_path):
    simulate_recording(tmp_path / "s", single(5, seconds=0.4, fps=10.0))
    told = run(EXAMPLES / "geodesics_of_one_picture.py", tmp_path / "s/recording", "--frame", "1")
    assert "head to FootLeft" in told


def test_the_answers_to_a_newcomers_questions_are_in_the_files_that_the_page_names():
    page, source = (ROOT / "docs/architecture.md").read_text(encoding="utf-8"), ROOT / "src/anchorpose"
    rows = re.findall(r"^\| [^|]+\? \| ([^|]+) \| ([^|]+) \|$", page, re.MULTILINE)
    assert len(rows) == 12
    for places, names in rows:
        for place, name in zip(re.findall(r"`([^`]+)`", places), re.findall(r"`([^`]+)`", names), strict=True):
            text = (source / place).read_text(encoding="utf-8")
            assert re.search(rf"^(def|class) {name}\b", text, re.MULTILINE), f"{place} has no {name}"


def test_the_code_on_the_page_is_the_way_of_a_frame():
    (shown,) = re.findall(
        r"^```python\n(.+?)^```$", (ROOT / "docs/architecture.md").read_text(), re.MULTILINE | re.DOTALL
    )
    assert textwrap.indent(shown, 8 * " ") in (ROOT / "src/anchorpose/tracker/patient.py").read_text()


def test_every_requirement_names_tests_that_exist():
    text = (ROOT / "docs" / "quality.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| .* \|$", text.split("## Requirements and their tests")[1].split("\n## ")[0], re.MULTILINE)[
        2:
    ]
    named = [re.findall(r"`((?:tests|benchmarks)/[^`]*)`", row) for row in rows]
    assert len(rows) > 15
    assert all(named)
    assert [path for paths in named for path in paths if not (ROOT / path.split()[0]).exists()] == []
