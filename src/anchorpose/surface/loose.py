"""Nodes without edges: what somebody's skin looks like where no geodesic is asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.camera import Camera
from anchorpose.surface.mesh import SheetConfig, build_surface
from anchorpose.surface.surface import Surface


def loose_surface(
    depths_m: Sequence[np.ndarray | None], masks: Sequence[np.ndarray | None], cameras: Sequence[Camera],
    config: SheetConfig,
) -> Surface:  # fmt: skip
    """The masked pixels of all cameras as nodes with normals, without ring and links; None: no picture."""
    sheets = [
        (number, build_surface(depth, mask, camera, config))
        for number, (depth, mask, camera) in enumerate(zip(depths_m, masks, cameras, strict=True))
        if depth is not None and mask is not None and mask.any()
    ]
    points = [sheet.points_m for _, sheet in sheets]
    count = sum(len(sheet) for _, sheet in sheets)
    return Surface(
        points_m=np.concatenate([np.zeros((0, 3), np.float32), *points]),
        normals=np.concatenate([np.zeros((0, 3), np.float32), *(sheet.normals for _, sheet in sheets)]),
        ring=np.full((count, 8), -1, np.int32),
        link_start=np.zeros(count + 1, np.int32),
        link_node=np.zeros(0, np.int32),
        link_length_m=np.zeros(0, np.float32),
        camera=np.concatenate([np.zeros(0, np.uint8), *(np.full(len(s), n, np.uint8) for n, s in sheets)]),
        pixel=np.concatenate([np.zeros((0, 2), np.int16), *(sheet.pixel for _, sheet in sheets)]),
        skin=np.full(count, -1, np.int32),
    )
