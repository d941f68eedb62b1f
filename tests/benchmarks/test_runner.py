"""The runner of the benchmarks: its cases, recordings, versions and tables."""

from __future__ import annotations

import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from intervals import paired_difference, wilson
from probing import run_probe, script_of
from recordings import OneFrame, Ready, Simulated
from room_suites import STARTS
from scores import LABELS
from suite import Probe
from suites import SUITES, cases_of, hard_scenes
from table import differences, table
from versions import REPOSITORY, Version, working_tree

from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.research.benchmark.labels import LABELLERS, read_label_set

PAGES = ("README.md", "CONTRIBUTING.md", *sorted(f"docs/{path.name}" for path in REPOSITORY.glob("docs/*.md")))


@pytest.mark.parametrize("suite", SUITES)
def test_every_probe_of_a_suite_exists_and_quick_takes_fewer_cases(suite):
    every, quick = (cases_of([suite], "tuning", few)[suite] for few in (False, True))
    assert {case.row for case in quick} <= {case.row for case in every}
    assert len(quick) <= len(every)
    scripts = {script_of(case.probe, working_tree()) for case in every if case.probe is not None}
    assert all(script.is_file() for script in scripts)


@pytest.mark.parametrize("suite", sorted(SUITES.keys() - {"real", "speed"}))
def test_no_simulated_recording_serves_both_uses(suite):
    tuning, held_out = (
        {
            case.recording.name
            for case in cases_of([suite], use, False)[suite]
            if not case.row.startswith(("captured", "real"))
        }
        for use in ("tuning", "held-out")
    )
    assert not tuning & held_out


def test_an_unknown_suite_is_refused():
    with pytest.raises(SystemExit, match="no suite hardest; there are easy, hard"):
        cases_of(["hardest"], "tuning", True)


def test_hard_scenes_for_tuning_show_nothing_of_what_is_held_out():
    tuning, held_out = (list(hard_scenes(use).values()) for use in ("tuning", "held-out"))
    assert not {s for config in tuning for s in config.subjects} & {s for config in held_out for s in config.subjects}
    assert len({config.movement for config in held_out} - {config.movement for config in tuning}) == 2
    assert {config.equipment for config in held_out} - {config.equipment for config in tuning} == {"sling"}


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("cache")


def test_a_recording_of_one_frame_opens_with_the_chosen_image_and_its_truth(cache):
    whole = Simulated("room", replace(STARTS["turned away"][0](3), seconds=0.4, fps=10.0))
    ready, source = OneFrame(whole, lambda joints_m: 2).ready(cache), whole.ready(cache)
    opened = open_recording(ready.recording)
    assert [len(stream.files) for stream in opened.streams] == [1]
    assert opened.backgrounds_m == (None,)
    np.testing.assert_array_equal(
        read_frame(opened, 0).depths_m[0], read_frame(open_recording(source.recording), 2).depths_m[0]
    )
    with np.load(ready.truth) as one, np.load(source.truth) as every:
        np.testing.assert_array_equal(one["joints"], every["joints"][[2]])
        assert one["names"].tolist() == every["names"].tolist()


@pytest.fixture
def code(tmp_path) -> Version:
    """A small version of the code."""
    package = tmp_path / "version" / "src" / "anchorpose"
    for name in ("tracker/run.py", "research/plan.py", "simulate/write.py"):
        (package / name).parent.mkdir(parents=True)
        (package / name).write_text("x = 1\n")
    return Version("small", tmp_path / "version", "0")


def test_a_probe_of_the_version_is_run_and_its_answer_kept(code, tmp_path):
    probe, ready = Probe("equipment", ("--trials", "2")), Ready("r", tmp_path, None, "d")
    own = code.root / "benchmarks" / "probes" / "equipment.py"
    assert script_of(probe, code) == REPOSITORY / "benchmarks" / "probes" / "equipment.py"
    own.parent.mkdir(parents=True)
    own.write_text(
        "import json, os, pathlib, sys\n"
        "made = pathlib.Path(sys.argv[1]) / 'made'\n"
        "made.write_text(made.read_text() + 'x' if made.exists() else 'x')\n"
        "rows = [['part', {'right': len(sys.argv), 'error_mm': float('nan')}]]\n"
        "pathlib.Path(sys.argv[sys.argv.index('--out') + 1]).write_text(json.dumps(rows))\n"
    )
    for again in (False, False, True):
        ((part, scores),) = run_probe(probe, ready, code, tmp_path / "cache", again)
        assert (part, scores["right"], np.isnan(scores["error_mm"])) == ("part", 7, True)
    assert (tmp_path / "made").read_text() == "xx"


def test_a_probe_that_fails_is_named_and_keeps_no_answer(code, tmp_path):
    own = code.root / "benchmarks" / "probes" / "equipment.py"
    own.parent.mkdir(parents=True)
    own.write_text("raise ValueError('no bars')")
    with pytest.raises(RuntimeError, match=r"(?s)equipment.py .*ValueError: no bars"):
        run_probe(Probe("equipment"), Ready("r", tmp_path, None, "d"), code, tmp_path / "cache", False)
    assert list((tmp_path / "cache").rglob("*.json")) == []


NAN = float("nan")
TRACKED = {"easy": [{"mean_mm": 8.0, "lost": 0.01, "right": 1.0}, {"mean_mm": 12.0, "lost": NAN, "right": 0.0}]}


def test_the_table_has_means_with_the_worst_and_what_is_not_known_stays_unknown():
    (line,) = [line for line in table(TRACKED).splitlines() if line.startswith("| easy")]
    assert line.startswith("| easy | 2 | 10.0 (12.0) | – | – |")
    assert "| 1.0 |" in line
    assert line.endswith("| right 1 of 2 (9 to 91 %) |")


def test_scores_of_a_probe_get_columns_of_their_own_and_trials_count():
    rows = {"kind": [{"trials": 20.0, "right": 0.95, "recovery_s": 0.1}, {"trials": 0.0, "right": NAN}]}
    head, _, line = table(rows).splitlines()
    assert head == "| scene | recordings | right % | recovery s | also |"
    assert line == "| kind | 2 | 95.0 | 0.10 | right 19 of 20 (76 to 99 %) |"


def test_differences_are_paired_by_recording():
    before = {"easy": [{"mean_mm": 10.0}, {"mean_mm": 12.0}]}
    line = differences(TRACKED, before, "753f79a").splitlines()[-1]
    assert line.startswith("| easy | -1.0 (-13.7 to +11.7) | – |")


def test_wilsons_interval_is_the_published_one():
    """Newcombe 1998 (doi:10.1002/(SICI)1097-0258(19980430)17:8<857::AID-SIM777>3.0.CO;2-E), table I."""
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert wilson(1, 29) == pytest.approx((0.0061, 0.1718), abs=1e-4)
    with pytest.raises(ValueError, match="no share"):
        wilson(0, 0)


def test_a_paired_difference_has_students_interval():
    """Differences 1, 2, 3: mean 2, standard error 1 / sqrt(3), t of 2 degrees of freedom 4.3027."""
    found = paired_difference([2.0, 4.0, 6.0, np.nan], [1.0, 2.0, 3.0, 0.0])
    assert (found.pairs, found.mean) == (3, pytest.approx(2.0))
    assert (found.low, found.high) == pytest.approx((2.0 - 4.3027 / 3**0.5, 2.0 + 4.3027 / 3**0.5), abs=1e-4)
    assert paired_difference([1.0], [0.5]).low is None
    assert paired_difference([np.nan], [0.5]) is None


def test_both_labelled_the_same_60_frames_twelve_of_each_subject():
    first, second = (read_label_set(LABELS, "msr_action3d", labeller) for labeller in LABELLERS)
    frames = {(sequence, number) for sequence, of in first.items() for number in of}
    assert frames == {(sequence, number) for sequence, of in second.items() for number in of}
    assert Counter(sequence.split("_")[1] for sequence, _ in frames) == {f"s0{k}": 12 for k in range(1, 6)}
    for labels in (first, second):
        for person in (person for of in labels.values() for people in of.values() for person in people):
            assert person.unclear <= set(person.joints) <= set(JOINT_INDEX)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_names_benchmarks_that_exist_or_the_commit_that_had_them(page):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    gone = {name for name in re.findall(r"benchmarks/[a-z_/]+\.py", text) if not (REPOSITORY / name).is_file()}
    assert not gone or re.search(r"of commit [0-9a-f]{7}|with commit 753f79a", text), gone


@pytest.mark.parametrize("page", PAGES)
def test_a_page_names_suites_that_exist(page):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    named = re.findall(r"benchmarks/run\.py((?: [a-z][a-z-]+)+)", text.replace("\n", " "))
    assert {suite for suites in named for suite in suites.split()} <= set(SUITES)
