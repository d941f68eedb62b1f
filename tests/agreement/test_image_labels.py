"""Labels in images against joints whose error in the image is known."""

import json

import numpy as np
import pytest
from recording_builder import write_recording
from results_builder import make_frame, standing_joints, write_results

from anchorpose.agreement.image_labels import evaluate_labels
from anchorpose.camera import transform_points
from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX, JointState
from anchorpose.recording.reader import open_recording

AWAY = np.array([[1.0, 0, 0, 0], [0, -1, 0, 1.0], [0, 0, -1, 3.0], [0, 0, 0, 1]])
"""T_camera_world: 3 m in front of the person, who stands at the origin."""


@pytest.fixture
def labelled(tmp_path):
    """A results folder, its recording, and labels: the knee 10 pixels off, the head right, a wrist lost."""
    recording = write_recording(tmp_path / "recording", frames=3)
    states = {"Head": JointState.HIDDEN}
    opened = open_recording(recording)
    times = opened.streams[0].time_s
    frames = [
        make_frame(int(n), float(t), standing_joints(), lost=("WristLeft",), states=states)
        for n, t in zip(opened.streams[0].frame, times, strict=True)
    ]
    results = write_results(tmp_path / "results", frames)
    run = json.loads((results / "run.json").read_text())
    run["cameras"][0]["camera_to_world"] = np.linalg.inv(AWAY).tolist()
    (results / "run.json").write_text(json.dumps(run))
    camera, rows = opened.cameras[0], ["camera,frame,joint,u,v"]
    for frame in opened.streams[0].frame:
        for joint, off in (("KneeLeft", 10.0), ("Head", 0.0), ("WristLeft", 0.0)):
            u, v = camera.project(transform_points(AWAY, standing_joints()[[JOINT_INDEX[joint]]]))[0]
            rows.append(f"{camera.name},{frame},{joint},{u + off},{v}")
    (tmp_path / "labels.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return results, recording, tmp_path / "labels.csv"


def test_errors_are_distances_in_the_image(labelled):
    results, recording, labels = labelled
    found = {row.name: row for row in evaluate_labels(results, recording, labels)}
    camera = open_recording(recording).cameras[0]
    assert found["KneeLeft"].median_px == pytest.approx(10.0)
    assert found["KneeLeft"].median_mm == pytest.approx(1000.0 * 10.0 * 3.0 / camera.intrinsics.fx, rel=0.02)
    assert found["inferred"].median_px == pytest.approx(0.0, abs=1e-6)
    assert (found["WristLeft"].lost, found["WristLeft"].median_px, found["WristLeft"].within_100) == (3, None, 0.0)
    assert (found["all joints"].labelled, found["all joints"].lost) == (9, 3)


def test_the_verb_prints_them_and_asks_for_the_recording(labelled, capsys, refusal):
    results, recording, labels = labelled
    command = ["evaluate", str(results), "--labels", str(labels)]
    assert "--recording" in refusal(command)
    assert main([*command, "--recording", str(recording)]) == 0
    assert "KneeLeft" in capsys.readouterr().out
    assert main([*command, "--truth", "t.npz"]) == 2  # one thing at a time


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a,b\n", "does not begin with"),
        ("camera,frame,joint,u,v\n", "no labels"),
        ("camera,frame,joint,u,v\nfront,0,Nose,1,2\n", "Nose"),
        ("camera,frame,joint,u,v\nfront,0,Head,1\n", "line 2"),
        ("camera,frame,joint,u,v\nback,0,Head,1,2\n", "'back'"),
        ("camera,frame,joint,u,v\nfront,99,Head,1,2\n", "no frame of these results"),
    ],
)
def test_labels_that_cannot_be_used_are_refused(labelled, text, problem):
    results, recording, labels = labelled
    labels.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=problem):
        evaluate_labels(results, recording, labels)
