"""A patient before a wall, parts of whom have another person's label."""

from types import SimpleNamespace

import numpy as np
from body_builder import FRONT, LEFT, adult_body, asset, before_wall, evidence_of, photograph, skin_in

from anchorpose.body.pose import Pose
from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.depth_noise import Sensor, neighbour_noise
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.tracker.bystanders import Bystanders

BODY, OTHER = adult_body(), int(PixelLabel.OTHER_PERSON)


def pieces_of(view: View, camera: Camera) -> Pieces:
    row, column = np.nonzero(view.labels >= PixelLabel.PATIENT)
    index = np.full(view.labels.shape, -1, np.int32)
    index[row, column] = np.arange(len(row))
    depth = view.depth_m[row, column]
    world = transform_points(camera.require_pose(), camera.back_project(view.depth_m)[row, column])
    area = depth**2 / (camera.intrinsics.fx * camera.intrinsics.fy)
    return Pieces(
        view.depth_m,
        view.labels,
        index,
        row.astype(np.int32),
        column.astype(np.int32),
        np.ones(len(row), np.int32),
        1,
        world.astype(np.float32),
        area.astype(np.float32),
        Sensor(2.0, camera.intrinsics.fx, noise_per_m=0.0012, noise=neighbour_noise(0.0012)),
    )


def seen(pose: Pose, mislabelled: tuple[str, ...]) -> SimpleNamespace:
    """What both cameras show of the patient, some bones with another person's label."""
    views = []
    for camera in (FRONT, LEFT):
        picture = photograph(skin_in(pose, BODY), camera)
        view = before_wall(picture, camera)
        theirs = np.isin(picture.part, [asset().bone(name) + 1 for name in mislabelled])
        views.append(View(view.depth_m, np.where(theirs, OTHER, view.labels).astype(np.uint8)))
    evidence = evidence_of(views, (FRONT, LEFT))
    pieces = tuple(pieces_of(view, camera) for view, camera in zip(views, (FRONT, LEFT), strict=True))
    return SimpleNamespace(
        evidence=evidence, surface=evidence.surface, pieces=pieces, bystanders=Bystanders(), frame_set=None
    )
