"""Events of a C3D as ezc3d reads them back."""

from dataclasses import replace

import numpy as np
import pytest
from results_builder import make_frame, standing_joints, write_results
from session_builder import contact

from anchorpose.agreement.reference import read_reference
from anchorpose.exports import c3d
from anchorpose.exports.c3d import add_events, read_events
from anchorpose.exports.exporting import export_results
from anchorpose.exports.formats import Format
from anchorpose.joints import JointState
from anchorpose.options import ExportConfig
from anchorpose.results.records import (
    CONTACTS_FILE,
    EPISODES_FILE,
    SIT_TO_STAND,
    STEP_LEFT,
    Episode,
    write_contacts,
    write_episodes,
)

ezc3d = pytest.importorskip("ezc3d")


@pytest.fixture
def results(tmp_path):
    """Two minutes from 5 s on at 10 frames a second, with a step, a rise and a contact."""
    folder = write_results(tmp_path / "results", [make_frame(i, 5.0 + i / 10, standing_joints()) for i in range(1200)])
    steps = [(STEP_LEFT, 6.0, 6.6), (SIT_TO_STAND, 70.0, 72.5)]
    seen = {"first_frame": 0, "last_frame": 1, "state": JointState.OBSERVED}
    write_episodes(folder / EPISODES_FILE, [Episode(kind=k, start_s=a, end_s=b, **seen) for k, a, b in steps])
    with write_contacts(folder / CONTACTS_FILE) as table:
        table.append(replace(contact("knee_left", "person 1", 0, 1), start_s=8.0, end_s=9.0))
    return folder


def test_events_have_the_labels_contexts_and_times_that_other_programs_read(results, tmp_path):
    export_results(results, (Format.C3D,), ExportConfig(), tmp_path / "out")
    file = ezc3d.c3d(str(tmp_path / "out/c3d/joints.c3d"))
    group = {name: file["parameters"]["EVENT"][name]["value"] for name in ("LABELS", "CONTEXTS", "TIMES", "USED")}
    assert group["USED"][0] == 6
    told = ["Foot Off", "Foot Strike", "Contact Start", "Contact End", "Stand Up Start", "Stand Up End"]
    assert (list(group["LABELS"]), list(group["CONTEXTS"])) == (told, ["Left", "Left", *["General"] * 4])
    seconds = np.array([60.0, 1.0]) @ np.asarray(group["TIMES"])  # from the file's first frame
    assert seconds == pytest.approx([1.0, 1.6, 3.0, 4.0, 65.0, 67.5], abs=1e-4)


def test_more_events_than_a_file_holds_lose_contacts_before_steps_and_none_make_no_group(results, monkeypatch):
    monkeypatch.setattr(c3d, "MOST_EVENTS", 2)
    file = ezc3d.c3d()
    assert add_events(file, read_events(results), np.arange(5.0, 125.0, 0.1)) == 2
    assert list(file["parameters"]["EVENT"]["LABELS"]["value"]) == ["Foot Off", "Foot Strike"]
    file = ezc3d.c3d()
    assert add_events(file, (), np.array([200.0, 201.0])) == 0
    assert "EVENT" not in file["parameters"]


def test_an_event_at_the_end_of_resampled_times_is_kept_and_one_outside_is_counted_apart(tmp_path):
    time_s = 5.0 + np.arange(60) / 10 + np.random.default_rng(3).uniform(-0.005, 0.005, 60)
    time_s[-1] = 10.89  # the last frame of the regular grid is almost a frame interval before
    frames = [make_frame(i, float(second), standing_joints()) for i, second in enumerate(time_s)]
    folder = write_results(tmp_path / "results", frames)
    seen = {"first_frame": 0, "last_frame": 1, "state": JointState.OBSERVED}
    rise = Episode(kind=SIT_TO_STAND, start_s=6.0, end_s=float(time_s[-1]), **seen)
    write_episodes(folder / EPISODES_FILE, [rise, replace(rise, start_s=2.0, end_s=12.0)])
    ((out, product),) = export_results(folder, (Format.C3D,), ExportConfig())
    file = ezc3d.c3d(str(out / "joints.c3d"))
    last_s = (file["data"]["points"].shape[2] - 1) / 10.0
    assert last_s < time_s[-1] - time_s[0]
    times_s = np.array([60.0, 1.0]) @ np.asarray(file["parameters"]["EVENT"]["TIMES"]["value"])
    assert times_s == pytest.approx([6.0 - time_s[0], last_s], abs=1e-4)
    assert any("0 of 4 did not fit" in note and "2 are at times outside" in note for note in product.notes)


def test_an_event_between_the_frames_of_two_files_is_in_one_of_them(results, monkeypatch):
    monkeypatch.setattr(c3d, "LARGEST_FRAMES", 600)
    seen = {"first_frame": 0, "last_frame": 1, "state": JointState.OBSERVED}
    rise = Episode(kind=SIT_TO_STAND, start_s=64.95, end_s=65.0, **seen)
    write_episodes(results / EPISODES_FILE, [rise])
    ((out, _),) = export_results(results, (Format.C3D,), ExportConfig())
    labels = [
        list(ezc3d.c3d(str(path))["parameters"]["EVENT"]["LABELS"]["value"]) for path in sorted(out.glob("*.c3d"))
    ]
    assert labels == [["Contact Start", "Contact End", "Stand Up Start"], ["Stand Up End"]]


def test_an_exported_c3d_is_understood_as_a_reference(results, tmp_path):
    export_results(results, (Format.C3D,), ExportConfig(), tmp_path / "out")
    found = read_reference(tmp_path / "out/c3d/joints.c3d")
    assert len(found.centres.joints) == 21
    assert found.centres.position_m[0] == pytest.approx(standing_joints(), abs=1e-5)
    assert "knee_flexion_left" in found.angles
