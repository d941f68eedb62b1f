"""Looking at one frame: the pictures show what the stages that track really did, and the page says what is missing."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from room_builder import FRONT, KNEE_BAR, ROOM, body, picture, write_room_recording

from anchorpose.cli import main
from anchorpose.joints import JOINT_NAMES
from anchorpose.pages.inspection_page import FACTS_FILE, Section, Stage, inspect_recording, write_inspection
from anchorpose.pipeline import track_recording
from anchorpose.results.tables import read_joints
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig

FPS, FRAMES, LOOKED_AT = 8.0, 4, 1
NAMES = "depth background standing_out equipment people surface geodesics anchors hypotheses tree registration"
STAGES = tuple(NAMES.split())


@dataclass(frozen=True, slots=True)
class Looked:
    """A simulated recording, the folder of the inspection of one frame, its page and its facts."""

    recording: Path
    folder: Path
    page: str
    facts: dict


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("inspect") / "simulated"
    simulate_recording(out, single(5, seconds=FRAMES / FPS, fps=FPS))
    return out / "recording"


@pytest.fixture(scope="module")
def looked(recording, tmp_path_factory) -> Looked:
    folder = tmp_path_factory.mktemp("looked") / "out"
    assert main(["inspect", str(recording), "--frame", str(LOOKED_AT), "-o", str(folder)]) == 0
    return Looked(recording, folder, (folder / "index.html").read_text(), json.loads((folder / FACTS_FILE).read_text()))


@pytest.mark.thorough
def test_every_stage_has_a_section_in_order_and_every_camera_a_picture_of_it(looked):
    assert tuple(re.findall(r'<section id="(\w+)"', looked.page)) == STAGES
    names = sorted(path.name for path in (looked.folder / "front").iterdir())
    assert names == [f"{n:02d}_{stage}.png" for n, stage in enumerate(STAGES, 1) if stage != "equipment"]
    assert all(cv2.imread(str(looked.folder / "front" / name)) is not None for name in names)
    assert looked.page.count("data:image/png;base64,") == len(STAGES) - 1
    assert "no equipment.json" in looked.page  # the one that is missing is explained


@pytest.mark.thorough
def test_the_page_loads_nothing_and_says_what_was_done(looked):
    assert re.findall(r"""(?:src|href)=["'](?!data:|#)""", looked.page) == []
    assert "first guess" in looked.page
    assert "not a medical device" in looked.page


@pytest.mark.thorough
def test_the_patients_pixels_are_blue_and_as_many_as_the_facts_say(looked):
    people = cv2.imread(str(looked.folder / "front" / "05_people.png")).astype(int)
    blue = (people[..., 0] > people[..., 2] + 60) & (people[..., 1] > people[..., 2] + 20)
    scale = people.shape[1] // 512
    assert blue.sum() / scale**2 == pytest.approx(looked.facts["pixels"]["front"]["patient"], rel=0.1)
    assert looked.facts["next_frame"] in (LOOKED_AT - 1, LOOKED_AT + 1)
    assert 100 < looked.facts["tree_matched"] <= looked.facts["tree_nodes"]


@pytest.mark.thorough
def test_as_tracked_shows_the_very_joints_of_track(recording, tmp_path):
    for name in ("tracked", "looked"):
        (tmp_path / name).mkdir()
    track_recording(recording, tmp_path / "tracked", TrackConfig(), lambda done, total: None)
    looked = inspect_recording(recording, tmp_path / "looked", LOOKED_AT, TrackConfig(), True, lambda: None)
    table = read_joints(tmp_path / "tracked" / "joints.parquet")
    assert looked.estimate is not None
    np.testing.assert_array_equal(looked.estimate.joints_m, table.position_m[LOOKED_AT])
    np.testing.assert_array_equal(looked.estimate.sigma_m, table.sigma_m[LOOKED_AT])
    assert [joint["joint"] for joint in json.loads((tmp_path / "looked" / FACTS_FILE).read_text())["joints"]] == [
        *JOINT_NAMES
    ]


def test_a_frame_that_does_not_exist_is_refused_in_one_sentence(recording, tmp_path, refusal):
    said = refusal(["inspect", str(recording), "--frame", "77", "-o", str(tmp_path / "out")]).strip()
    assert "has no frame 77 (its frames are 0 to 3)" in said
    assert "\n" not in said
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_a_foreign_folder_is_never_touched_and_an_own_one_only_when_asked(recording, looked, tmp_path, refusal):
    (tmp_path / "letter.txt").write_text("mine")
    command = ["inspect", str(recording), "--frame", "0", "-o"]
    assert main([*command, str(tmp_path), "--overwrite"]) == 2
    assert "--overwrite" in refusal([*command, str(looked.folder)])
    assert (tmp_path / "letter.txt").read_text() == "mine"


def test_without_anybody_the_earlier_stages_are_shown_and_the_page_says_why(tmp_path):
    empty = write_room(tmp_path / "empty", people=False)
    assert main(["inspect", str(empty), "--frame", "1", "-o", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "index.html").read_text()
    names = {path.stem[3:] for path in (tmp_path / "out" / "front").iterdir()}
    assert names == {"depth", "background", "standing_out", "equipment", "people"}
    assert "Nobody was seen in the frames that were sampled" in page
    assert page.count('class="missing"') == 6


@pytest.mark.thorough
def test_what_is_no_body_is_shown_up_to_its_anchors(tmp_path):
    column = write_room(tmp_path / "column", people=True)
    assert main(["inspect", str(column), "--frame", "1", "-o", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "index.html").read_text()
    names = {path.stem[3:] for path in (tmp_path / "out" / "front").iterdir()}
    assert {"surface", "geodesics", "anchors"} <= names
    if "registration" not in names:
        assert "No body explains what is seen" in page
    equipment = cv2.imread(str(tmp_path / "out" / "front" / "04_equipment.png")).astype(int)
    orange = (equipment[..., 2] > equipment[..., 0] + 60) & (equipment[..., 1] > equipment[..., 0] + 20)
    assert orange.sum() > 1000


def test_names_cannot_become_markup_and_pictures_lie_in_folders_of_their_cameras(tmp_path):
    section = Section(
        stage=Stage(key="depth", title="<b>", caption="", draw=lambda one: None),
        caption="a & b",
        pictures={"left": b"png"},
    )
    page = write_inspection(tmp_path, "<script>", [section], ["1 < 2"], {"frame": 1}).read_text()
    assert (tmp_path / "left" / "01_depth.png").read_bytes() == b"png"
    assert "<script>" not in page
    assert "1 &lt; 2" in page
    assert "a &amp; b" in page


def write_room(folder: Path, people: bool) -> Path:
    """A small recording of the tests' room with its knee bar and, perhaps, a column that stands for a person."""
    someone = body(0.0, 0.0) if people else ()
    images = [picture(FRONT, *ROOM, KNEE_BAR, *someone, seed=n + 1) for n in range(3)]
    return write_room_recording(folder, FRONT, picture(FRONT, *ROOM, KNEE_BAR, seed=0), images, KNEE_BAR)
