"""MeshHOG, SIFT and LD-SIFT in plain numpy, a node at a time: what the kernels are held to and how much they gain."""

import numpy as np

from anchorpose.research.features.depth_map import image_side
from anchorpose.research.features.ld_sift import REACH, Beyond, LdSiftConfig
from anchorpose.research.features.mesh_hog import MeshHogConfig
from anchorpose.research.features.rings import rings_within
from anchorpose.surface.mesh import faces
from anchorpose.surface.surface import Surface


def shares(turn: float, bins: int) -> np.ndarray:
    """(bins,) how a unit is shared between the middles of the bins around a circle; turn in radians."""
    gap = np.abs((turn / (2 * np.pi) * bins - np.arange(bins) - 0.5 + bins / 2) % bins - bins / 2)
    return np.maximum(1.0 - gap, 0.0)


def ring_of(surface: Surface, reach_m: float, node: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes within reach of one, and their distances."""
    rings = rings_within(surface, reach_m)
    row = slice(rings.start[node], rings.start[node + 1])
    return rings.node[row], rings.distance_m[row]


def plain_mesh_hog(surface: Surface, config: MeshHogConfig, gradients: np.ndarray, node: int) -> np.ndarray:
    """(width,) for one node, from the gradients (n, 3) of all."""
    near, distance_m = ring_of(surface, config.radius_m, node)
    keep = (near != node) & np.isfinite(gradients[near, 0])
    away = (surface.points_m[near] - surface.points_m[node])[keep].astype(np.float64)
    slope, normal = gradients[near[keep]].astype(np.float64), surface.normals[node].astype(np.float64)
    weight = np.exp(-0.5 * (distance_m[keep] / (config.radius_m * config.spread)) ** 2)
    flat = np.eye(3) - np.outer(normal, normal) / (normal @ normal)
    direction, size = away @ flat, np.linalg.norm(slope, axis=1)
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    begin = (unit * (weight * size)[:, None]).sum(axis=0)
    begin /= np.linalg.norm(begin)
    beside = np.cross(normal, begin)
    polar = sum(
        w * shares(np.arctan2(d @ beside, d @ begin), config.directions)
        for w, d in zip(weight * size, unit, strict=True)
    )
    for _ in range(config.smoothing):
        polar = 0.25 * np.roll(polar, 1) + 0.5 * polar + 0.25 * np.roll(polar, -1)
    peak = int(np.argmax(polar))
    low, top, high = polar[peak - 1], polar[peak], polar[(peak + 1) % len(polar)]
    angle = (peak + 0.5 + (low - high) / (2 * (low - 2 * top + high))) * 2 * np.pi / config.directions
    first = np.cos(angle) * begin + np.sin(angle) * beside
    blocks = []
    for pole, zero in ((normal, first), (np.cross(normal, first), first), (first, normal)):
        quarter = np.cross(pole, zero)
        block = np.zeros((config.slices, config.orientations))
        for d, g, w in zip(away, slope, weight, strict=True):
            at, to = np.arctan2(d @ quarter, d @ zero), np.arctan2(g @ quarter, g @ zero)
            length = np.hypot(g @ quarter, g @ zero)
            block += w * length * np.outer(shares(at, config.slices), shares(to, config.orientations))
        blocks.append(block.ravel())
    histogram = np.concatenate(blocks)
    return histogram / np.linalg.norm(histogram)


def plain_sift(picture: np.ndarray, samples: int) -> np.ndarray:
    """(128,) written out pixel by pixel and bin by bin."""
    middle, bins = (len(picture) - 1) / 2, np.zeros((4, 4, 8))
    for i in range(1, len(picture) - 1):
        for j in range(1, len(picture) - 1):
            slopes = []
            for before, after in ((picture[i, j - 1], picture[i, j + 1]), (picture[i - 1, j], picture[i + 1, j])):
                known = [value for value in (before, picture[i, j], after) if np.isfinite(value)]
                steps = 2 if len(known) == 3 else 1
                slopes.append(2 * (known[-1] - known[0]) / steps if len(known) > 1 else np.nan)
            if not np.isfinite([picture[i, j], *slopes]).all():
                continue
            y, x = (i - middle) / samples, (j - middle) / samples
            weight = np.hypot(*slopes) * np.exp(-(x * x + y * y) / 8)
            turn = np.arctan2(slopes[1], slopes[0]) / (2 * np.pi) * 8
            near_row, near_column = (np.maximum(1 - np.abs(v - (np.arange(4) - 1.5)), 0) for v in (y, x))
            near_turn = np.maximum(1 - np.abs((turn - np.arange(8) + 4) % 8 - 4), 0)
            bins += weight * near_row[:, None, None] * near_column[:, None] * near_turn
    unit = np.minimum(bins / np.linalg.norm(bins), 0.2)
    return (unit / np.linalg.norm(unit)).ravel()


def plain_ld_sift(surface: Surface, config: LdSiftConfig, node: int) -> np.ndarray:
    """(128,) with each pixel of the depth map looked for in all triangles."""
    half = config.radius_m
    near, _ = ring_of(surface, half * REACH, node)
    normal = surface.normals[node].astype(np.float64)
    first = np.cross(normal, [0.3, -0.5, 0.8])
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(normal, first), normal])
    local = (surface.points_m.astype(np.float64) - surface.points_m[node]) @ frame.T
    triangles = faces(surface)
    triangles = triangles[np.isin(triangles, near).all(axis=1)]
    a, b, c = (local[triangles[:, k]] for k in range(3))
    plane = np.cross(b - a, c - a)
    centre, area = (a + b + c)[:, :2] / 3, plane[:, 2]
    gradient = -plane[:, :2] / plane[:, 2:]
    weight = np.where(area > 0, area, 0) * np.exp(-0.5 * (centre**2).sum(axis=1) / (0.5 * half) ** 2)
    axis = np.linalg.eigh((centre * weight[:, None]).T @ centre)[1][:, 1]
    axis *= 1 if (weight[:, None] * gradient).sum(axis=0) @ axis > 0 else -1
    side = image_side(config.samples)
    picture = np.full((side, side), -config.floor_m if config.beyond is Beyond.FLOOR else np.nan)
    for i, j in np.ndindex(side, side):
        along, across = (np.array([j, i]) - (side - 1) / 2) * half / (2 * config.samples)
        p = along * axis + across * np.array([-axis[1], axis[0]])
        with np.errstate(divide="ignore", invalid="ignore"):
            beta = ((p - a[:, :2])[:, 0] * (c - a)[:, 1] - (p - a[:, :2])[:, 1] * (c - a)[:, 0]) / area
            gamma = ((b - a)[:, 0] * (p - a[:, :2])[:, 1] - (b - a)[:, 1] * (p - a[:, :2])[:, 0]) / area
            over = (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1)
        if over.any():
            heights = (a[:, 2] + beta * (b - a)[:, 2] + gamma * (c - a)[:, 2])[over]
            picture[i, j] = np.fmax(picture[i, j], heights.max())
    return plain_sift(picture, config.samples)
