"""The foreground of a view, as isolation finds it."""

import numpy as np

from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.depth_noise import Sensor, neighbour_noise
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View


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
