"""A small recording with its results, made up in two seconds, and a viewer of them for the tests of the page."""

import json
import struct
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from recording_builder import BOX, camera_entry, write_picture, write_timestamps
from results_builder import make_frame, standing_joints, write_explained_frames
from scipy.spatial.transform import Rotation
from session_builder import contact

from anchorpose.body.pose import MOVING_BONES
from anchorpose.body.segments import load_body_asset
from anchorpose.joints import JOINT_INDEX, JointState
from anchorpose.recording.reader import input_files, open_recording
from anchorpose.recording.recording import Clock
from anchorpose.results.explained import ExplainedFrame
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.records import CONTACTS_FILE, PEOPLE_FILE, LabelImage, write_contacts, write_people
from anchorpose.results.run_record import RUN_FILE, hash_files
from anchorpose.results.tables import (
    ANCHORS_FILE,
    ANGLES_FILE,
    JOINTS_FILE,
    POSES_FILE,
    AnchorFrame,
    BodyPose,
    JointFrame,
    read_joints,
    write_anchors,
    write_angles,
    write_joints,
    write_poses,
)
from anchorpose.viewer.payloads import ALIGNED, MAGIC
from anchorpose.viewer.server import ViewerServer, open_viewer

WIDTH, HEIGHT, FRAMES, PERIOD_S = 96, 128, 45, 1.0 / 15.0
FOCAL = 110.0
LOST_FRAME, UNSURE_FRAME = 30, 12

REASON = "was seen in place in 9 of 9 frames, of 2 people"
BODY = {"learnt_from_s": 4.0, "height_m": 1.7, "height_sigma_m": 0.01, "clothes_m": {}, "bones": []}
BODY |= {"coefficients": [0.0] * 16}
BODY_TURN = Rotation.from_rotvec([0.0, 0.6, 0.0])  # all bones alike: the body of the page is the rest body, turned
BODY_SHIFT_M = np.array([0.05, 0.02, 0.1])

POSES = {
    "front": np.array([[0, 0, -1, 2.4], [0, -1, 0, 1.0], [-1, 0, 0, 0.0], [0, 0, 0, 1.0]]),
    "right": np.array([[1.0, 0, 0, 0.0], [0, -1, 0, 1.0], [0, 0, -1, 2.4], [0, 0, 0, 1.0]]),
}


def patient_mask() -> np.ndarray:
    """(HEIGHT, WIDTH) bool: a person's outline, more or less."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(mask, (48, 34), 6, 1, -1)
    cv2.rectangle(mask, (38, 42), (58, 72), 1, -1)
    for x in (40, 52):
        cv2.rectangle(mask, (x, 72), (x + 5, 108), 1, -1)
    return mask.astype(bool)


def labels_of(frame: int) -> np.ndarray:
    """The patient (4), another person (5) who walks by, a bar (2), the room (0)."""
    labels = np.where(patient_mask(), np.uint8(4), np.uint8(0))
    labels[60:110, 2 + frame : 12 + frame] = 5
    labels[80:84, 30:66] = 2
    return labels


def depth_mm(frame: int) -> np.ndarray:
    """(HEIGHT, WIDTH) uint16: the patient at 2.4 m, round, the other people in front, the wall behind."""
    labels = labels_of(frame)
    columns = np.abs(np.arange(WIDTH) - 48)
    grey = np.full((HEIGHT, WIDTH), 3500, np.uint16)
    patient = np.broadcast_to(2300 + 6 * columns, grey.shape)
    grey[labels == 4] = patient[labels == 4]
    grey[labels == 5] = 1900
    grey[labels == 2] = 2100
    grey[:3] = 0  # no reading
    return grey


def write_small_recording(folder: Path) -> Path:
    """Two cameras, a bar as equipment."""
    folder.mkdir(parents=True)
    cameras = []
    for name, pose in POSES.items():
        for frame in range(FRAMES):
            write_picture(folder / name / "depth" / f"{frame:06d}.png", depth_mm(frame))
        write_timestamps(folder / name, [(frame, frame * PERIOD_S) for frame in range(FRAMES)])
        intrinsics = {"fx": FOCAL, "fy": FOCAL, "cx": 48.0, "cy": 64.0, "distortion": [0.05, -0.02, 0.001, 0.0, 0.0]}
        size = {"width": WIDTH, "height": HEIGHT, "intrinsics": intrinsics, "camera_to_world": pose.tolist()}
        cameras.append(camera_entry(name) | size)
    box = BOX | {"center": [0.3, 0.6, 0], "size": [0.05, 0.09, 0.7]}
    equipment = {"format": "equipment-model", "version": 1, "parts": [box]}
    (folder / "equipment.json").write_text(json.dumps(equipment))
    document = {"format": "rgbd-recording", "version": 1, "cameras": cameras, "equipment": "equipment.json"}
    (folder / "recording.json").write_text(json.dumps(document))
    return folder


def write_small_results(
    folder: Path, recording: Path, people: bool = True, explained: Sequence[ExplainedFrame] = ()
) -> Path:
    """A patient who sways and bends a knee; all joints lost in one frame, a hand unsure in another.

    explained: the rows of explained.parquet; without them there is none, as in results of an older release.
    """
    folder.mkdir(parents=True)
    with (
        write_joints(folder / JOINTS_FILE) as joints,
        write_poses(folder / POSES_FILE) as poses,
        write_anchors(folder / ANCHORS_FILE) as anchors,
        write_contacts(folder / CONTACTS_FILE) as contacts,
    ):
        for frame in range(FRAMES):
            joints.append(_joints(frame))
            poses.append(_pose(frame))
            place = np.full((5, 3), np.nan)
            place[0] = (0.0, 1.7, 0.0)
            anchors.append(AnchorFrame(frame, frame * PERIOD_S, place, np.where(np.isnan(place[:, 0]), np.nan, 0.02)))
        contacts.append(replace(contact("knee_left", "person 1", 5, 20), start_s=5 * PERIOD_S, end_s=20 * PERIOD_S))
    write_angles(folder / ANGLES_FILE, joint_angles(read_joints(folder / JOINTS_FILE)))
    if people:
        with write_people(folder / PEOPLE_FILE) as pictures:
            for frame in range(FRAMES):
                for name in POSES:
                    pictures.append(LabelImage(frame, name, cv2.imencode(".png", labels_of(frame))[1].tobytes()))
    if explained:
        write_explained_frames(folder, explained)
    opened = open_recording(recording)
    document = {
        "format": "anchorpose-run",
        "version": 1,
        "recording": "ward 3",
        "frame_count": FRAMES,
        "cameras": [
            {"name": n, "camera_to_world": T.tolist(), "source": "given", "clock": asdict(Clock())}
            for n, T in POSES.items()
        ],
        "residuals": [],
        "association": {"matched_share": [None, *[0.97] * (FRAMES - 1)]},
        "dropped": [{"frame": 3, "time_s": 0.2, "why": "front/depth/000003.png is truncated"}],
        "patient": {"frame": 2, "xz_m": [0.1, 0.05], "reason": REASON, "rival_xz_m": [0.4, -0.9]},
        "body": BODY,
        "notes": [],
        "inputs_sha256": dict(hash_files(input_files(opened), recording)),
    }
    (folder / RUN_FILE).write_text(json.dumps(document))
    return folder


def write_small_session(folder: Path, **more: Any) -> tuple[Path, Path]:
    """The small results and their recording."""
    recording = write_small_recording(folder / "recording")
    return write_small_results(folder / "results", recording, **more), recording


@contextmanager
def viewer_of(results: Path, recording: Path | None = None, host: str = "127.0.0.1") -> Iterator[ViewerServer]:
    """A running viewer on a free port of this machine."""
    server = open_viewer(results, recording, None, "", host, 0)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def _joints(frame: int) -> JointFrame:
    place = standing_joints()
    place[:, 2] += 0.05 * np.sin(frame / 7.0)
    place[JOINT_INDEX["KneeLeft"], 0] += 0.15 * np.sin(frame / 10.0) ** 2
    lost = tuple(JOINT_INDEX) if frame == LOST_FRAME else ()
    states = {"WristLeft": JointState.HIDDEN_BY_PERSON} if frame % 10 < 4 else {}
    made = make_frame(frame, frame * PERIOD_S, place, lost, 0.02, states)
    if frame == UNSURE_FRAME:
        made.sigma_m[JOINT_INDEX["HandRight"]] = 0.2
    return made


def _pose(frame: int) -> BodyPose:
    asset = load_body_asset()
    heads = BODY_TURN.apply(np.stack([asset.bone_heads[asset.bone(name)] for name in MOVING_BONES])) + BODY_SHIFT_M
    turn = np.tile(BODY_TURN.as_quat(scalar_first=True), (len(MOVING_BONES), 1))
    gone = np.nan if frame == LOST_FRAME else 0.0
    return BodyPose(frame, frame * PERIOD_S, heads + gone, turn + gone, np.full(len(MOVING_BONES), np.nan))


def unpack(data: bytes) -> tuple[Any, dict[str, np.ndarray]]:
    """The meta and the arrays of ``pack``: the counterpart in Python of what the page does in JavaScript."""
    if data[:4] != MAGIC:
        raise ValueError("these bytes were not made by pack")
    (length,) = struct.unpack_from("<I", data, 4)
    head, first = json.loads(data[8 : 8 + length]), 8 + length + -(8 + length) % ALIGNED
    arrays = {}
    for entry in head["arrays"]:
        kind = np.dtype(entry["type"]).newbyteorder("<")
        count = int(np.prod(entry["shape"], dtype=np.int64))
        arrays[entry["name"]] = np.frombuffer(data, kind, count, first + entry["start"]).reshape(entry["shape"])
    return head["meta"], arrays
