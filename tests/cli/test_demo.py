"""The demo: what it writes and says, and when it opens the browser."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stand_in_pipeline
from results_builder import make_frame, standing_joints, write_results

from anchorpose.cli import main
from anchorpose.cli.console import open_page
from anchorpose.cli.demo_verb import account
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, JointState
from anchorpose.results.evaluate import Evaluation, evaluate


def evaluated(tmp_path: Path, off_m: np.ndarray, **more: Any) -> Evaluation:
    """Two frames in which each joint is (21,) metres off to the right."""
    shifted = standing_joints() + off_m[:, None] * [0.0, 0.0, 1.0]
    results = write_results(tmp_path / "results", [make_frame(i, i / 10, shifted, **more) for i in range(2)])
    truth = {"joints": np.stack([standing_joints()] * 2), "names": np.array(JOINT_NAMES), "time": np.arange(2) / 10}
    np.savez(tmp_path / "truth.npz", **truth)
    return evaluate(results, tmp_path / "truth.npz")


def test_the_closing_words_state_what_a_known_result_is(tmp_path):
    """Nineteen joints 10 mm off, the neck 5 mm, the left wrist 31 mm; a sigma of 10 mm covers 19.6 mm."""
    off_m = np.full(JOINT_COUNT, 0.010)
    off_m[JOINT_INDEX["Neck"]], off_m[JOINT_INDEX["WristLeft"]] = 0.005, 0.031
    hidden = {"WristLeft": JointState.HIDDEN_BY_EQUIPMENT}
    assert account(evaluated(tmp_path, off_m, states=hidden, sigma_m=0.010)) == [
        "Joints are 11 mm off on average; 95 of 100 are at most 10 mm off.",
        "95 % of the joints were seen: 10 mm off on average.",
        "5 % of the joints were hidden and inferred: 31 mm off on average.",
        "The best joint is the neck (5 mm), the worst the left wrist (31 mm).",
        "Knee flexion is 0.0 degrees off on the left and 0.0 on the right.",
        "The stated uncertainty covers the true position on 98 of 100 axes; 95 is exact.",
        "No joint was ever more than 150 mm off.",
    ]


def test_what_is_lost_is_stated_and_nothing_is_made_up(tmp_path):
    assert account(evaluated(tmp_path, np.zeros(JOINT_COUNT), lost=JOINT_NAMES)) == [
        "100 % of the joints are lost: these have no position.",
        "Every joint with a true position was lost in the results: no error is known.",
    ]


@pytest.fixture
def opened(monkeypatch) -> list[str]:
    """The pages that the browser was asked for, where a display is there."""
    pages = list[str]()
    monkeypatch.setattr("webbrowser.open", lambda page: pages.append(page) is None)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":0")
    for name in ("CI", "SSH_CONNECTION", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return pages


def at_terminal(monkeypatch, answer: bool = True) -> None:
    """Lets the output go to a terminal; called in a test, because each phase of one has an output of its own."""
    monkeypatch.setattr(sys.stdout, "isatty", lambda: answer, raising=False)


@pytest.fixture
def demo(tmp_path, monkeypatch) -> Path:
    """A folder to run the demo in, with the tracker replaced."""
    monkeypatch.setitem(sys.modules, "anchorpose.pipeline", stand_in_pipeline)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "anchorpose-demo"


def test_the_demo_writes_everything_it_names_and_refuses_to_replace_it(demo, opened, monkeypatch, capsys):
    at_terminal(monkeypatch)
    assert main(["demo", "--quick"]) == 0
    assert {path.name for path in demo.iterdir()} == {"simulated", "results", "evaluation.json"}
    assert (demo / "results" / "report.html").exists()
    printed = capsys.readouterr().out
    assert "open in the browser: anchorpose-demo/results/report.html" in printed
    assert opened == [(demo / "results" / "report.html").as_uri()]
    assert len(printed.splitlines()) < 20
    assert "┃" not in printed  # no tables
    assert main(["demo", "--quick"]) == 2
    assert {path.name for path in demo.parent.iterdir()} == {"anchorpose-demo"}


def test_tables_and_a_closed_browser_are_options(tmp_path, demo, opened, monkeypatch, capsys):
    at_terminal(monkeypatch)
    found = evaluated(tmp_path, np.full(JOINT_COUNT, 0.010))
    monkeypatch.setattr("anchorpose.cli.demo_verb._simulate_and_track", lambda out, seconds: found)
    assert main(["demo", "--quick", "--tables", "--no-open"]) == 0
    printed = capsys.readouterr().out
    assert "all joints" in printed
    assert "a page for the browser: anchorpose-demo/results/report.html" in printed
    assert opened == []


@pytest.mark.parametrize(
    ("platform", "environment", "opens"),
    [
        ("linux", {"DISPLAY": ":0"}, True),
        ("linux", {"WAYLAND_DISPLAY": "wayland-0"}, True),
        ("linux", {"DISPLAY": "localhost:10", "SSH_CONNECTION": "1"}, True),  # its windows come back over ssh
        ("linux", {}, False),
        ("linux", {"DISPLAY": ":0", "CI": "true"}, False),
        ("darwin", {}, True),
        ("darwin", {"SSH_CONNECTION": "1"}, False),
        ("win32", {"CI": "1"}, False),
    ],
)
def test_a_page_opens_only_where_somebody_sees_it(tmp_path, monkeypatch, opened, platform, environment, opens):
    at_terminal(monkeypatch)
    monkeypatch.delenv("DISPLAY")
    monkeypatch.setattr(sys, "platform", platform)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert open_page(tmp_path / "page.html") is opens
    assert len(opened) == opens


def test_nothing_opens_for_a_program_that_reads_the_output(tmp_path, monkeypatch, opened):
    at_terminal(monkeypatch, False)
    assert not open_page(tmp_path / "page.html")
    assert opened == []
