"""Real depth of real rooms: nothing crashes, what cannot be tracked is lost and not invented, and the choice is said.

The recordings are for development only and not part of the project; without them these tests skip.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES
from anchorpose.pipeline import track_recording
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.tracker.config import TrackConfig

pytestmark = pytest.mark.thorough

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
MSR = DATA / "msr_action3d"
SEQUENCES = sorted(folder.name for folder in MSR.glob("a*_s*_e*")) or ["a01_s01_e02"]

RIGID_LIMBS = [
    (JOINT_INDEX[start + side], JOINT_INDEX[end + side])
    for side in ("Left", "Right")
    for start, end in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Hip", "Knee"), ("Knee", "Ankle"), ("Ankle", "Foot"))
]
"""One bone from end to end; between the other joints of the picture lie joints of the spine, pelvis and collarbone."""


ADULT_LEG_M = (0.60, 1.10)
"""Hip to knee to ankle: 0.67 m of the shipped body at 1.45 m, 1.01 m at 2.0 m, and a tenth for what is unknown."""


@dataclass(frozen=True, slots=True)
class Excerpt:
    """A few frames of a recording, from ``start`` on."""

    folder: str
    start: int
    count: int
    people: int
    in_full_view: bool  # so that the patient must be found


EXCERPTS = (
    Excerpt("msr_action3d/a01_s01_e02", 0, 5, 1, True),
    Excerpt("msr_action3d/a13_s01_e02", 16, 3, 1, False),  # bent over, the head before the chest
    Excerpt("iit_rehab_room", 80, 4, 1, False),  # walks in sideways; the camera smooths a decimetre away
    Excerpt("five_people", 0, 1, 5, False),
    Excerpt("realsense_board", 0, 2, 1, False),
)


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """An excerpt with what was written of it."""

    excerpt: Excerpt
    results: Path
    joints: JointTable

    @property
    def notes(self) -> str:
        """All sentences of run.json's notes."""
        return "\n".join(read_run(self.results / RUN_FILE)["notes"])


@pytest.fixture(scope="module", params=EXCERPTS, ids=lambda excerpt: excerpt.folder)
def tracked(request, tmp_path_factory) -> Tracked:
    excerpt = request.param
    results = tmp_path_factory.mktemp("results")
    config = TrackConfig(start=excerpt.start, stop=excerpt.start + excerpt.count)
    track_recording(_present(DATA / excerpt.folder), results, config, lambda _done, _total: None)
    return Tracked(excerpt, results, read_joints(results / JOINTS_FILE))


def _present(folder: Path) -> Path:
    if not (folder / "recording.json").is_file():
        pytest.skip(f"{folder.relative_to(DATA.parent)} is absent: real depth is not part of the project")
    return folder


def test_every_frame_has_its_21_joints_in_order(tracked):
    rows = pq.read_table(tracked.results / JOINTS_FILE)
    wanted = range(tracked.excerpt.start, tracked.excerpt.start + tracked.excerpt.count)
    assert rows["frame"].to_pylist() == [frame for frame in wanted for _ in range(JOINT_COUNT)]
    assert rows["joint"].to_pylist() == list(JOINT_NAMES) * len(wanted)


def test_a_lost_joint_has_no_numbers_and_bones_keep_their_length(tracked):
    _assert_lost_is_null(tracked.joints)
    _assert_bones_keep_their_length(tracked.joints)


def test_the_run_says_who_was_taken_for_the_patient(tracked):
    assert "the patient was taken to be the person at" in tracked.notes
    if tracked.excerpt.people > 1:
        assert f"of {tracked.excerpt.people} people" in tracked.notes


def test_who_is_in_full_view_is_tracked(tracked):
    if not tracked.excerpt.in_full_view:
        pytest.skip("bent, cut off, hidden or poorly measured: lost is a fair answer")
    assert tracked.joints.lost.mean() < 0.25


def test_the_legs_are_as_long_as_an_adults(tracked):
    least_m, most_m = ADULT_LEG_M
    for side in ("Left", "Right"):
        hip, knee, ankle = (tracked.joints.position_m[:, JOINT_INDEX[part + side]] for part in ("Hip", "Knee", "Ankle"))
        leg_m = np.linalg.norm(hip - knee, axis=1) + np.linalg.norm(knee - ankle, axis=1)
        leg_m = leg_m[np.isfinite(leg_m)]
        assert ((leg_m > least_m) & (leg_m < most_m)).all()


def test_the_shoulders_of_a_standing_man_are_where_another_tracker_found_them(tracked):
    skeleton = DATA / tracked.excerpt.folder / "skeleton.npz"
    if not skeleton.is_file() or not tracked.excerpt.in_full_view:
        pytest.skip("no reference, or none for a person in full view")
    for name in ("ShoulderLeft", "ShoulderRight"):
        distance_m = _from_reference_m(tracked.joints, tracked.results, skeleton, name)
        assert np.median(distance_m) < 0.10  # the reference is good to 5 to 10 cm


@pytest.mark.slow
def test_who_has_touched_the_floor_is_whole_on_standing_again(tmp_path):
    """A bent trunk beside the legs looks like a second person: it was labelled as one, and the pose collapsed.

    The reference stands up with left and right exchanged: what lies between them is compared.
    """
    folder = _present(MSR / "a13_s01_e02")
    track_recording(folder, tmp_path, TrackConfig(), lambda _done, _total: None)
    joints = read_joints(tmp_path / JOINTS_FILE)
    for pair in ("Shoulder", "Knee"):
        distance_m = _from_reference_m(joints, tmp_path, folder / "skeleton.npz", pair + "Left", pair + "Right")
        assert np.median(distance_m[-10:]) < 0.10  # the reference is good to 5 to 10 cm


@pytest.mark.slow
@pytest.mark.parametrize("sequence", SEQUENCES)
def test_every_sequence_of_an_action_is_tracked_without_a_crash(sequence, tmp_path):
    folder = _present(MSR / sequence)
    track_recording(folder, tmp_path, TrackConfig(), lambda _done, _total: None)
    joints = read_joints(tmp_path / JOINTS_FILE)
    assert len(joints.frame) == len(list((folder / "front" / "depth").glob("*.png")))
    _assert_lost_is_null(joints)
    _assert_bones_keep_their_length(joints)


def _from_reference_m(joints: JointTable, results: Path, skeleton: Path, *names: str) -> np.ndarray:
    """(t,) distance of the middle of some joints from that of the reference's."""
    with np.load(skeleton) as file:
        of = [list(file["names"]).index(name) for name in names]
        camera_m = file["xyz"][joints.frame][:, of, :3].mean(axis=1) * [1.0, -1.0, 1.0]
    T_world_camera = np.array(read_run(results / RUN_FILE)["cameras"][0]["camera_to_world"])
    world_m = camera_m @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    own_m = joints.position_m[:, [JOINT_INDEX[name] for name in names]].mean(axis=1)
    return np.linalg.norm(own_m - world_m, axis=1)


def _assert_lost_is_null(joints: JointTable) -> None:
    assert np.isnan(joints.position_m[joints.lost]).all()
    assert np.isnan(joints.sigma_m[joints.lost]).all()
    assert np.isfinite(joints.position_m[~joints.lost]).all()
    assert (joints.sigma_m[~joints.lost] > 0).all()


def _assert_bones_keep_their_length(joints: JointTable) -> None:
    for start, end in RIGID_LIMBS:
        length_m = np.linalg.norm(joints.position_m[:, start] - joints.position_m[:, end], axis=1)
        known_m = length_m[np.isfinite(length_m)]
        assert not len(known_m) or np.ptp(known_m) < 1e-6, (JOINT_NAMES[start], JOINT_NAMES[end])
