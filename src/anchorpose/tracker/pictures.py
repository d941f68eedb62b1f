"""Pictures of what the stages made of a frame, for the report."""

from __future__ import annotations

import numpy as np

from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.results.overlay import OverlayScene, draw_frame
from anchorpose.results.pictures import FramePicture
from anchorpose.surface.mesh import edges
from anchorpose.tracker.estimate import Estimate


def draw_estimate(estimate: Estimate, shape: FittedShape) -> list[FramePicture]:
    """One picture a camera: depth, mesh, anchors, the body's outline and the joints."""
    if estimate.observation is None or estimate.belief is None:
        return []
    asset = body_points().asset
    body = shape.body(asset)
    pose = estimate.belief.pose
    skin = body.skin(body.bone_transforms(pose.rotations, pose.root_m))
    evidence, surface = estimate.observation.evidence, estimate.observation.surface
    all_edges = edges(surface)
    pictures = []
    for number, (camera, view) in enumerate(zip(evidence.cameras, evidence.views, strict=True)):
        if view is None:
            continue
        own = surface.camera == number
        scene = OverlayScene(
            camera=camera,
            depth_m=view.depth_m,
            labels=view.labels,
            mesh_m=surface.points_m,
            mesh_edges=all_edges[own[all_edges].all(axis=1)],
            anchors_m=estimate.observation.anchors.position_m,
            anchor_names=ANCHOR_NAMES,
            joints_m=estimate.joints_m,
            joint_states=estimate.states,
            body_m=skin,
            body_faces=asset.faces,
        )
        frame = estimate.frame_set
        caption = _caption(estimate)
        pictures.append(FramePicture(frame.frame, frame.time_s, camera.name, draw_frame(scene), caption))
    return pictures


def _caption(estimate: Estimate) -> str:
    found = int(estimate.observation.anchors.found.sum()) if estimate.observation else 0
    known = np.isfinite(estimate.sigma_m)
    sigma = f", joints to about {1000 * np.median(estimate.sigma_m[known]):.0f} mm" if known.any() else ""
    return f"{found} of {len(ANCHOR_NAMES)} anchors found{sigma}"
