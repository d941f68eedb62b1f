"""The runner of the benchmarks: its cases, recordings, versions and tables."""

import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from intervals import paired_difference, wilson
from probing import script_of
from recordings import OneFrame, Simulated, code_of
from remarks import REMARKS
from room_suites import STARTS
from run import Plan, rows_of, run_suite
from scores import LABELS
from suites import SUITES, cases_of, hard_scenes
from tracking import compile_clock
from versions import REPOSITORY, working_tree

from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.research.benchmark.labels import LABELLERS, read_label_set

PAGES = ("README.md", "CONTRIBUTING.md", *sorted(f"docs/{path.name}" for path in REPOSITORY.glob("docs/*.md")))


@pytest.mark.thorough
@pytest.mark.parametrize("suite", SUITES)
def test_every_probe_of_a_suite_exists_and_quick_takes_fewer_cases(suite):
    every, quick = (cases_of([suite], "tuning", few)[suite] for few in (False, True))
    assert {case.row for case in quick} <= {case.row for case in every}
    assert len(quick) <= len(every)
    version = working_tree()
    scripts = {script_of(case.probe, version) for case in every if case.probe is not None}
    assert all(script.is_file() for script in scripts)


def test_rows_that_no_suite_has_are_refused(tmp_path):
    with pytest.raises(RuntimeError, match="real has no row with ghosts in its name"):
        run_suite("real", Plan("tuning", False, tmp_path, (), rows="ghosts"), 1)


@pytest.mark.parametrize("suite", sorted(SUITES.keys() - {"real", "speed", "sync"}))
def test_no_simulated_recording_serves_both_uses(suite):
    cases = [cases_of([suite], use, False)[suite] for use in ("tuning", "held-out")]
    made = [{c.recording.name for c in of if not c.row.startswith(("captured", "real"))} for of in cases]
    assert not made[0] & made[1]


def test_hard_scenes_for_tuning_show_nothing_of_what_is_held_out():
    tuning, held_out = (list(hard_scenes(use).values()) for use in ("tuning", "held-out"))
    assert not {s for config in tuning for s in config.subjects} & {s for config in held_out for s in config.subjects}
    assert len({config.movement for config in held_out} - {config.movement for config in tuning}) == 2
    assert {config.equipment for config in held_out} - {config.equipment for config in tuning} == {"sling"}


def test_other_words_are_the_same_code_and_other_values_are_not(tmp_path):
    source = '"""A module."""\nA = {0}\n"""m, a length."""\ndef f():\n    """Return A."""\n    return "{1}"\n'
    written = {}
    for name, text in {
        "first": source.format(1, "a"),
        "reworded": source.format(1, "a")
        .replace("A module", "The module")
        .replace("length", "width")
        .replace("Return A", "A"),
        "value": source.format(2, "a"),
        "text": source.format(1, "b"),
    }.items():
        (tmp_path / f"{name}.py").write_text(text)
        written[name] = code_of(tmp_path / f"{name}.py")
    assert written["first"] == written["reworded"]
    assert len(set(written.values())) == 3


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


def test_a_row_that_a_case_has_twice_counts_twice_and_versions_stay_aligned():
    left, right, other = {"off": 1.0}, {"off": 2.0}, {"off": 3.0}
    now, before = [("knee", left), ("knee", right)], [("knee", other), ("hand", left)]
    assert rows_of([[now, before], [now, now]], 2) == [
        {"knee": [left, right, left, right], "hand": [{}]},
        {"knee": [other, {}, left, right], "hand": [left]},
    ]


def test_time_spent_compiling_is_counted_by_the_clock_from_which_it_is_subtracted():
    import numba

    readings = []
    spent_s = compile_clock(lambda: float(readings.append(None) or len(readings)))
    assert spent_s() == 0.0
    inner = numba.njit(lambda x: x + 1)
    assert numba.njit(lambda x: inner(x) + 1)(1) == 3
    assert len(readings) == 2  # one beginning and one end: the inner function is compiled within the outer one
    assert spent_s() == 1.0


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


def test_labels_of_a_joint_give_its_offset_spread_and_share_within_sigma():
    random = np.random.default_rng(7)
    tracked_mm, labels_mm = random.normal(0.0, 20.0, (4000, 2)), random.normal(0.0, 30.0, (2, 4000, 2))
    away = tracked_mm + np.array([5.0, 60.0]) - labels_mm.mean(axis=0)
    apart = np.linalg.norm(labels_mm[0] - labels_mm[1], axis=1)
    names = ("right_mm", "below_mm", "apart_mm", "stated_mm")
    measured = [dict(zip(names, (*one, between, 20.0), strict=True)) for one, between in zip(away, apart, strict=True)]
    words = {remark.name: remark.words(measured) for remark in REMARKS}
    found = [float(words[name]) for name in ("below", "labellers", "spread", "label_band")]
    expected = [60.0, 30.0 / np.sqrt(2.0), np.hypot(20.0, 30.0 / np.sqrt(2.0)), 95.0]
    np.testing.assert_allclose(found, expected, atol=1.5)


def test_both_labelled_the_same_60_frames_twelve_of_each_subject():
    first, second = (read_label_set(LABELS, "msr_action3d", labeller) for labeller in LABELLERS)
    frames = {(sequence, number) for sequence, of in first.items() for number in of}
    assert frames == {(sequence, number) for sequence, of in second.items() for number in of}
    assert Counter(sequence.split("_")[1] for sequence, _ in frames) == {f"s0{k}": 12 for k in range(1, 6)}
    for labels in (first, second):
        for person in (person for of in labels.values() for people in of.values() for person in people):
            assert person.unclear <= set(person.joints) <= set(JOINT_INDEX)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_names_benchmarks_and_suites_that_exist(page):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    assert {name for name in re.findall(r"benchmarks/[a-z_/]+\.py", text) if not (REPOSITORY / name).is_file()} == set()
    named = re.findall(r"benchmarks/run\.py((?: [a-z][a-z-]+)+)", text.replace("\n", " "))
    assert {suite for suites in named for suite in suites.split()} <= set(SUITES)
