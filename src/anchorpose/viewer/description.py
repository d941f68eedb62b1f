"""What the page must know before it shows a frame: names, cameras, equipment, contacts, and where to look first.

The frames that a reviewer should look at first, and why each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.joints import JOINT_NAMES, LIMBS, JointState
from anchorpose.results.run_record import as_json
from anchorpose.results.tables import JointTable
from anchorpose.viewer.depth_frames import Footage
from anchorpose.viewer.review import Review

APART_S: Final = 1.0  # two frames nearer than this show the same thing
MOST_OF_A_KIND: Final = 12
FEW_MATCHED: Final = 0.9  # the usual share on sound recordings is 0.95 to 1


@dataclass(frozen=True, slots=True)
class WorstFrame:
    """A row of the results to look at, its reason for people, and the joint it is about, if it is one."""

    position: int
    reason: str
    joint: int | None


def worst_frames(
    joints: JointTable, matched_share: np.ndarray, dropped: Sequence[dict[str, Any]]
) -> tuple[WorstFrame, ...]:
    """Lost joints first, then pictures that could not be used, few matches, and the largest sigma.

    matched_share (n,): NaN where nothing was asked. Each kind: the worst, then the worst a second away, and so on.
    """
    return (
        *_lost(joints),
        *_dropped(joints, dropped),
        *_unmatched(joints, matched_share),
        *_unsure(joints),
    )


def _lost(joints: JointTable) -> list[WorstFrame]:
    count = joints.lost.sum(axis=1)
    found = []
    for position in _apart(np.where(count > 0, count.astype(float), np.nan), joints.time_s):
        names = [JOINT_NAMES[joint] for joint in np.flatnonzero(joints.lost[position])]
        told = "all joints lost" if len(names) == len(JOINT_NAMES) else f"lost: {', '.join(names)}"
        found.append(WorstFrame(position, told, None))
    return found


def _dropped(joints: JointTable, dropped: Sequence[dict[str, Any]]) -> list[WorstFrame]:
    rows = {int(number): row for row, number in enumerate(joints.frame)}
    known = [drop for drop in dropped if drop["frame"] in rows]
    return [WorstFrame(rows[drop["frame"]], drop["why"], None) for drop in known[:MOST_OF_A_KIND]]


def _unmatched(joints: JointTable, share: np.ndarray) -> list[WorstFrame]:
    few = np.where(share < FEW_MATCHED, 1.0 - share, np.nan)
    return [
        WorstFrame(row, f"{100 * share[row]:.0f} % of the points found again in the next frame", None)
        for row in _apart(few, joints.time_s)
    ]


def _unsure(joints: JointTable) -> list[WorstFrame]:
    worst = np.where(np.isnan(joints.sigma_m), -np.inf, joints.sigma_m).max(axis=1)
    found = []
    for row in _apart(np.where(np.isfinite(worst), worst, np.nan), joints.time_s):
        joint = int(np.nanargmax(joints.sigma_m[row]))
        found.append(WorstFrame(row, f"{JOINT_NAMES[joint]}: sigma {1000 * joints.sigma_m[row, joint]:.0f} mm", joint))
    return found


def _apart(badness: np.ndarray, time_s: np.ndarray) -> list[int]:
    """Rows by falling badness, none within ``APART_S`` of a worse one; NaN is no candidate."""
    chosen: list[int] = []
    for row in np.argsort(-badness, kind="stable"):
        if np.isnan(badness[row]) or len(chosen) == MOST_OF_A_KIND:
            break
        if all(abs(time_s[row] - time_s[other]) >= APART_S for other in chosen):
            chosen.append(int(row))
    return chosen


def describe(review: Review) -> dict[str, Any]:
    """Plain values for JSON; positions are rows of the results' frames."""
    footage = review.footage
    return {
        "name": review.name,
        "recording": review.run["recording"],
        "frames": len(review.joints.frame),
        "joints": list(JOINT_NAMES),
        "limbs": [list(limb) for limb in LIMBS],
        "states": [str(state) for state in JointState],
        "anchors": list(ANCHOR_NAMES),
        "angles": list(review.angles.names),
        "contacts": [{**as_json(contact), "state": contact.state} for contact in review.contacts],
        "worst": as_json(worst_frames(review.joints, review.matched_share, review.run.get("dropped", []))),
        "dropped": review.run.get("dropped", []),
        "notes": review.run.get("notes", []),
        "has": {
            "body": review.poses is not None and review.run.get("body") is not None,
            "anchors": review.anchors is not None,
            "recording": footage is not None,
            "people": footage is not None and footage.people is not None,
        },
        "cameras": [] if footage is None else _cameras(footage),
        "equipment": None if footage is None else _equipment(footage),
    }


def _cameras(footage: Footage) -> list[dict[str, Any]]:
    return [
        {
            "name": camera.name,
            "width": camera.width,
            "height": camera.height,
            "depth_scale": camera.depth_scale,
            "fx": camera.intrinsics.fx,
            "fy": camera.intrinsics.fy,
            "cx": camera.intrinsics.cx,
            "cy": camera.intrinsics.cy,
            "camera_to_world": None if camera.T_world_camera is None else camera.T_world_camera.tolist(),
        }
        for camera in footage.cameras
    ]


def _equipment(footage: Footage) -> dict[str, Any] | None:
    model = footage.recording.equipment
    if model is None:
        return None
    vertices, faces = model.triangles()
    return {"vertices": vertices.round(4).ravel().tolist(), "faces": faces.ravel().tolist()}
