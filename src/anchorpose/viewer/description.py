"""What the page must know before it shows a frame: names, cameras, equipment, contacts, and where to look first."""

from __future__ import annotations

from typing import Any

from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.joints import JOINT_NAMES, LIMBS, JointState
from anchorpose.results.run_record import plain
from anchorpose.viewer.footage import Footage
from anchorpose.viewer.review import Review
from anchorpose.viewer.worst import worst_frames


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
        "contacts": [{**plain(contact), "state": contact.state} for contact in review.contacts],
        "worst": plain(worst_frames(review.joints, review.matched_share, review.run.get("dropped", []))),
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
