"""The public benchmark on two seconds of one seed: what is made, what answers score, and what is refused."""

import hashlib
import json
import runpy
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_NAMES
from anchorpose.research.benchmark import answers, make, plan, real, score
from anchorpose.research.benchmark.plan import Group, Part
from anchorpose.research.benchmark.truth import truth_of
from anchorpose.research.experiment.correspondence import Skin
from anchorpose.results.truth import read_truth
from anchorpose.simulate.clinic import draw_clinic

EXAMPLE = Path(__file__).parents[3] / "examples" / "take_part_in_the_benchmark.py"
GROUP, OTHER = Group(Part.DEVELOPMENT, False, 7601), Group(Part.DEVELOPMENT, False, 7602)
FRAMES, TASK, GAP = 20, "tracking-0.15m", "association-0.3s"


@pytest.fixture(scope="module", autouse=True)
def _short():
    with pytest.MonkeyPatch.context() as patch:
        for module in (plan, answers):
            patch.setattr(module, "SECONDS", 2.0)
        patch.setattr(plan, "FIRST_FRAMES", (3,))
        patch.setattr(make, "reference", dict)
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory, _short) -> make.Benchmark:
    """Two groups: one simulated, and a copy of it under another name."""
    folder = tmp_path_factory.mktemp("b") / "benchmark"
    make.make_group(GROUP, folder)
    shutil.copytree(folder / GROUP.name, folder / OTHER.name)
    (folder / make.DOCUMENT).write_text(json.dumps({"format": make.FORMAT, "version": make.VERSION, "recordings": {}}))
    return make.make_benchmark(folder, [GROUP, OTHER], 1, lambda done, total: None)


def joint_table(made: make.Benchmark, shift_m: float = 0.0, groups=(GROUP, OTHER)) -> pa.Table:
    """The true joints of a task, moved along x, with a sigma of a centimetre."""
    truth = read_truth(GROUP.truth(made.folder)).position_m + np.array([shift_m, 0.0, 0.0])
    tables = []
    for group in groups:
        columns = {"recording": [group.recordings[TASK]] * truth[..., 0].size}
        columns |= {"frame": np.repeat(np.arange(FRAMES), 21), "joint": list(JOINT_NAMES) * FRAMES}
        columns |= {f"{axis}_m": truth[..., i].ravel() for i, axis in enumerate("xyz")}
        tables.append(pa.table({**columns, "sigma_m": np.full(truth[..., 0].size, 0.01)}))
    return pa.concat_tables(tables)


def write_answers(folder: Path, name: str = "joints", table: pa.Table | str | None = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "answers.json").write_text(
        json.dumps({"format": answers.FORMAT, "version": make.VERSION, "method": "mine"})
    )
    if isinstance(table, str):
        (folder / f"{name}.csv").write_text(table)
    elif table is not None:
        pyarrow.csv.write_csv(table, folder / f"{name}.csv")
    return folder


def scored(folder: Path, made: make.Benchmark) -> score.Score:
    return score.score_answers(made, answers.read_answers(folder, made), Part.DEVELOPMENT)


def best_matches(made: make.Benchmark) -> pa.Table:
    return pa.csv.read_csv(made.folder / GROUP.name / "matches.csv")


def alone(made: make.Benchmark) -> make.Benchmark:
    """Without the copy, whose seed would tell of another skin."""
    return make.Benchmark(made.folder, (GROUP,), ())


def test_true_joints_score_zero_and_lie_within_their_sigma(made, tmp_path):
    found = scored(write_answers(tmp_path / "a", table=joint_table(made)), made)
    assert list(found.tasks) == [TASK]
    one = found.tasks[TASK]
    assert one.mean_mm == pytest.approx(0.0, abs=1e-6)
    assert (one.recordings, one.asked, one.missing_share) == (2, 2 * FRAMES * 21, 0.0)
    assert (one.within_50mm, one.coverage_95, one.none_share) == (1.0, 1.0, 0.0)


def test_joints_moved_by_60_mm_score_60_mm_on_one_axis_of_three(made, tmp_path):
    one = scored(write_answers(tmp_path / "a", table=joint_table(made, 0.06)), made).tasks[TASK]
    assert (one.mean_mm, one.median_mm) == pytest.approx((60.0, 60.0))
    assert (one.within_50mm, one.within_100mm) == (0.0, 1.0)
    assert one.coverage_95 == pytest.approx(2 / 3)


def test_what_is_left_out_is_counted_and_lies_outside_of_every_share(made, tmp_path):
    table = joint_table(made, groups=(GROUP,))
    folder = write_answers(tmp_path / "a", table=table.filter(pa.compute.greater(table["frame"], 4)))
    one = scored(folder, made).tasks[TASK]
    assert one.missing_share == pytest.approx((FRAMES + 5) / (2 * FRAMES))
    assert one.within_50mm == pytest.approx(1.0 - one.missing_share)
    assert one.mean_mm == pytest.approx(0.0, abs=1e-6)


def test_empty_places_and_no_sigma_are_missing_and_no_coverage(made, tmp_path):
    table = joint_table(made).drop_columns("sigma_m")
    for axis in "xyz":
        blank = pa.array([None] * 42 + table[f"{axis}_m"].to_pylist()[42:], pa.float64())
        table = table.set_column(table.column_names.index(f"{axis}_m"), f"{axis}_m", blank)
    folder = write_answers(tmp_path / "a")
    pyarrow.parquet.write_table(table, folder / "joints.parquet")
    one = scored(folder, made).tasks[TASK]
    assert one.missing_share == pytest.approx(42 / (2 * FRAMES * 21))
    assert one.coverage_95 is None


@pytest.mark.thorough
def test_true_matches_are_as_near_as_nodes_are_to_each_other(made, tmp_path):
    found = scored(write_answers(tmp_path / "a", "matches", best_matches(made)), alone(made))
    assert list(found.tasks) == list(plan.GAPS)
    for one in found.tasks.values():
        assert (one.missing_share, one.none_share) == (0.0, 0.0)
        assert one.within_50mm > 0.99  # where skin touches skin, the nearest vertex may be of the other limb
        assert one.median_mm < 13.0  # the distance of neighbours; each place is known to its nearest vertex only


@pytest.mark.thorough
def test_matches_of_a_hand_on_the_other_hand_are_as_far_off_as_the_way_over_the_body(made):
    pair = GROUP.pairs[0]
    truth = truth_of(made.folder / GROUP.name, pair, Skin(GROUP.simulation))
    seen = np.flatnonzero(truth.places.seen)
    left, right = (seen[np.argmax(sign * truth.first_m[seen, 2])] for sign in (-1, 1))
    match = np.full(len(truth.first_m), answers.NO_MATCH)
    match[left] = truth.nearest()[right]
    straight_mm = 1000 * np.linalg.norm(truth.first_m[left] - truth.first_m[right])
    assert truth.error_mm(match)[left] > max(1000.0, straight_mm)
    assert np.isnan(truth.error_mm(match)[right])


@pytest.mark.thorough
def test_matches_without_row_and_without_match_are_told_apart(made, tmp_path):
    table = best_matches(made)
    chosen = np.array(table["task"]) == GAP
    keep = ~chosen | (np.array(table["node"]) >= 100)
    match = table["match"].to_numpy().astype(float)
    match[chosen & (np.array(table["node"]) < 300)] = np.nan
    changed = table.set_column(3, "match", pa.array(match, from_pandas=True).cast(pa.int64())).filter(pa.array(keep))
    one = scored(write_answers(tmp_path / "a", "matches", changed), alone(made)).tasks[GAP]
    truth = truth_of(made.folder / GROUP.name, GROUP.pairs[1], Skin(GROUP.simulation))
    seen = truth.places.seen
    assert one.missing_share == pytest.approx(seen[:100].sum() / seen.sum())
    assert one.none_share == pytest.approx(seen[100:300].sum() / seen.sum())
    answered = 1.0 - one.missing_share - one.none_share
    assert answered - 0.01 < one.within_50mm <= answered


def test_two_answers_are_compared_recording_by_recording(made, tmp_path):
    near, far = (scored(write_answers(tmp_path / str(s), table=joint_table(made, s)), made) for s in (0.01, 0.06))
    found = score.compare(far, near)[TASK]
    assert (found["mm"], found["mm_low"], found["mm_high"]) == pytest.approx((50.0,) * 3)
    assert found["within_50mm"] == pytest.approx(-1.0)


HEAD = "recording,frame,joint,x_m,y_m,z_m,sigma_m\n"
ROW = f"{GROUP.recordings[TASK]},0,Head,0.1,1.6,0.0,0.01\n"
MATCH_HEAD, PAIR = "task,pair,node,match\n", f"{GROUP.name}/000003"


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("joints", HEAD.replace("z_m,", "") + "a,0,Head,1,1,1\n", "no column z_m"),
        ("joints", HEAD.replace("sigma_m", "sigma_mm") + ROW, "unknown column sigma_mm"),
        ("joints", HEAD.replace("sigma_m", "z_m") + ROW, "two columns 'z_m'"),
        ("joints", HEAD + ROW.replace("7601", "9999"), "unknown recording"),
        ("joints", HEAD + ROW.replace("Head", "Nose"), "unknown joint 'Nose' in row 1"),
        ("joints", HEAD + ROW.replace(",0,Head", ",20,Head"), "frames are 0 to 19"),
        ("joints", HEAD + ROW.replace("1.6", "1600"), "over 100 m away in row 1 after the header; give metres"),
        ("joints", HEAD + ROW.replace("1.6", ""), "part of a position"),
        ("joints", HEAD + ROW.replace("0.01", "0"), "not above 0"),
        ("joints", HEAD + ROW + ROW, "repeats an earlier row in row 2"),
        ("joints", HEAD + ROW.replace("1.6", "up"), "cannot be read"),
        ("joints", HEAD + "," + ROW.partition(",")[2], "has no recording in row 1"),
        ("matches", MATCH_HEAD + f"association-2s,{PAIR},0,0\n", "unknown task"),
        ("matches", MATCH_HEAD + f"{GAP},{PAIR}9,0,0\n", "unknown pair"),
        ("matches", MATCH_HEAD + f"{GAP},{PAIR},0,99999\n", "no such node in row 1"),
        ("matches", MATCH_HEAD + f"{GAP},{PAIR},-1,0\n", "has a node below 0 in row 1"),
        ("matches", MATCH_HEAD + f"{GAP},{PAIR},0,1\n{GAP},{PAIR},0,2\n", "repeats an earlier row in row 2"),
    ],
)
def test_wrong_answers_are_refused_in_a_sentence_that_names_file_and_row(made, tmp_path, refusal, name, text, said):
    folder = write_answers(tmp_path / "a", name, text)
    sentence = refusal(["benchmark", "score", str(folder), str(made.folder), "--part", "development"])
    assert said in sentence
    assert f"{name}.csv" in sentence
    assert sentence.count("\n") == 1


@pytest.mark.parametrize("about", [None, "{", '{"format": "x"}', '{"format": "anchorpose-benchmark-answers"}', "[1]"])
def test_answers_without_a_word_about_them_are_refused(made, tmp_path, about):
    folder = write_answers(tmp_path / "a", table=HEAD + ROW)
    (folder / "answers.json").unlink() if about is None else (folder / "answers.json").write_text(about)
    with pytest.raises(InputError, match=r"answers\.json"):
        answers.read_answers(folder, made)


def test_two_tables_of_one_kind_and_no_table_are_refused(made, tmp_path):
    with pytest.raises(InputError, match="has no answers"):
        answers.read_answers(write_answers(tmp_path / "none"), made)
    folder = write_answers(tmp_path / "two", table=HEAD + ROW)
    pyarrow.parquet.write_table(joint_table(made), folder / "joints.parquet")
    with pytest.raises(InputError, match="keep one of the two"):
        answers.read_answers(folder, made)


@pytest.mark.thorough
def test_other_bytes_are_named_by_recording_and_altered_truth_is_refused(made, tmp_path, monkeypatch):
    folder = tmp_path / "copy"
    shutil.copytree(made.folder, folder)
    known = make._read_document(folder)
    monkeypatch.setattr(make, "reference", lambda: known)
    assert make.make_benchmark(folder, [GROUP], 1, lambda done, total: None).other_bytes == ()
    image = folder / GROUP.recordings["tracking-0.03m"] / "front" / "depth" / "000005.png"
    depth = cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
    depth[200, 250] += 1
    cv2.imwrite(str(image), depth)
    (sentence,) = make.make_benchmark(folder, [GROUP], 1, lambda done, total: None).other_bytes
    assert sentence.startswith(f"{GROUP.recordings['tracking-0.03m']}: its depth differ")
    with np.load(GROUP.truth(folder)) as file:
        arrays = dict(file)
    arrays["joints"][3, 4] += 0.001
    np.savez(GROUP.truth(folder), **arrays)
    with pytest.raises(InputError, match=r"truth\.npz: is not as it was made"):
        make.open_benchmark(folder)


@pytest.mark.parametrize("text", ["", "[]", '{"format": "rgbd-recording"}', '{"format": "anchorpose-benchmark"}'])
def test_a_folder_that_is_no_benchmark_is_not_touched(tmp_path, text):
    (tmp_path / "benchmark.json").write_text(text)
    with pytest.raises(InputError, match="is not a benchmark's"):
        make.make_benchmark(tmp_path, [GROUP], 1, lambda done, total: None)
    assert [path.name for path in tmp_path.iterdir()] == ["benchmark.json"]


def test_holes_are_in_the_same_frames_and_grow_with_their_size(made):
    depths = {}
    for task, name in GROUP.recordings.items():
        files = sorted((made.folder / name).glob("front/depth/*.png"))
        assert not any(path.is_symlink() for path in files)
        depths[task] = np.array([cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in files])
    whole = depths["tracking-0.00m"]
    gone = {task: ((depth == 0) & (whole > 0)).sum(axis=(1, 2)) for task, depth in depths.items()}
    holed = gone["tracking-0.15m"] > 0
    assert not holed[0]
    assert 0.2 < holed.mean() < 0.8
    assert ((gone["tracking-0.15m"] > 4 * gone["tracking-0.06m"]) == holed).all()


def test_the_reference_has_the_true_joints_that_the_simulator_makes(monkeypatch):
    monkeypatch.setattr(plan, "SECONDS", 6.0)
    text = (Path(make.__file__).parent / make.REFERENCE).read_text()
    known = json.loads(text)["recordings"]
    assert set(known) == {name for group in plan.ALL_GROUPS for name in group.recordings.values()}
    clinic = draw_clinic(GROUP.simulation)
    joints = np.rint(clinic.act(clinic.true_times_s(0)).joints_m() / make.TRUTH_UNIT_M).astype("<i4")
    assert known[GROUP.recordings[TASK]]["truth"] == hashlib.sha256(joints.tobytes()).hexdigest()


def test_real_labels_are_compared_in_the_cameras_frame(tmp_path, made):
    recordings, labels = tmp_path / "recordings", tmp_path / "labels"
    shutil.copytree(made.folder / GROUP.recordings["tracking-0.00m"], recordings / "room")
    recording = make.open_recording(recordings / "room")
    camera = recording.cameras[0]
    truth = read_truth(GROUP.truth(made.folder)).position_m[7]
    inside = make.transform_points(np.linalg.inv(camera.require_pose()), truth)
    pixel = camera.project(inside)
    named = {name: pixel[JOINT_NAMES.index(name)].tolist() for name in ("Head", "KneeLeft", "KneeRight")}
    people = [{"person": "A", "plain": True, "box": [0, 0, 511, 423], "joints": named}]
    labels.mkdir()
    for labeller in ("first", "second"):
        (labels / f"room.{labeller}.json").write_text(json.dumps({"frames": {"7": people}}))
    folder = write_answers(tmp_path / "a")
    rows = [
        f"room,A,7,{name},{inside[i, 0] + 0.03},{inside[i, 1]},{inside[i, 2]}"
        for i, name in enumerate(JOINT_NAMES)
        if name != "KneeRight"
    ]
    (folder / "real.csv").write_text("\n".join(["recording,person,frame,joint,x_m,y_m,z_m", *rows]))
    one = real.score_real(folder, recordings, labels)["room"]
    assert (one.asked, one.missing_share) == (6, pytest.approx(1 / 3))
    assert one.median_mm == pytest.approx(30.0, abs=2.5)  # at the depth of the skin, not of the joint behind it
    assert one.within_50mm == pytest.approx(2 / 3)
    with pytest.raises(InputError, match="has no recording with labels"):
        real.score_real(folder, tmp_path, labels)


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("room,A,7,Head,2,2,2", "repeats an earlier row in row 3 after the header"),
        ("room,B,7,Head,1,1,1", "names an unknown person in row 3 after the header"),
        ("room,A,-7,Head,1,1,1", "has a frame without labels in row 3 after the header"),
        ("room,A,8,Head,1,1,1", "has a frame without labels in row 3 after the header"),
        ("hall,A,7,Head,1,1,1", "names the unknown recording 'hall' in row 3 after the header"),
        ("room,A,7,Nose,1,1,1", "names the unknown joint 'Nose' in row 3 after the header"),
    ],
)
def test_answers_on_real_depth_are_refused_by_their_row(tmp_path, row, problem):
    people = [{"person": "A", "box": [0, 0, 9, 9]}]
    for labeller in ("first", "second"):
        (tmp_path / f"room.{labeller}.json").write_text(json.dumps({"frames": {"7": people}}))
    (tmp_path / "many.first.json").write_text(json.dumps({"recordings": {}}))
    rows = ["recording,person,frame,joint,x_m,y_m,z_m", "room,A,7,Head,1,1,1", "room,A,7,Neck,1,1,1", row]
    (tmp_path / "real.csv").write_text("\n".join(rows))
    with pytest.raises(InputError, match=problem):
        real.score_real(tmp_path, tmp_path, tmp_path)


def test_a_folder_without_labels_is_refused(tmp_path):
    with pytest.raises(InputError, match="has no labels"):
        real.score_real(tmp_path, tmp_path, tmp_path)


@pytest.mark.thorough
def test_a_foreign_method_takes_part_and_its_figures_are_written(made, tmp_path, monkeypatch, capsys):
    assert "import anchorpose" not in EXAMPLE.read_text()
    assert "from anchorpose" not in EXAMPLE.read_text()
    monkeypatch.setattr(
        sys, "argv", [str(EXAMPLE), str(tmp_path / "one pair"), str(tmp_path / "a"), "--part", "development"]
    )
    folder = tmp_path / "one pair"  # the first, so that it takes no longer than it must
    folder.mkdir()
    (folder / "development").symlink_to(made.folder / "development")
    lines = (made.folder / "pairs.csv").read_text().splitlines()
    (folder / "pairs.csv").write_text("\n".join(lines[:2]) + "\n")
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    best = write_answers(tmp_path / "best", "matches", best_matches(made))
    command = ["benchmark", "score", str(tmp_path / "a"), str(made.folder), "--part", "development"]
    assert main([*command, "--against", str(best)]) == 0
    document = json.loads((tmp_path / "a" / "score.json").read_text())
    one = document["tasks"]["association-0.1s"]
    assert one["missing_share"] == pytest.approx(0.5, abs=0.02)  # of the second recording nothing was answered
    assert one["within_50mm"] > 0.45
    assert document["tasks"]["clinic"] is None
    assert document["against"]["differences"]["association-0.1s"]["mm"] > 0.0
    assert document["row"].startswith("| bending sheet | ")
    assert document["row"] in capsys.readouterr().out
