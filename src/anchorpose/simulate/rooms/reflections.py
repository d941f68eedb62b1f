"""Render a room without its people: everything that never moves, furniture that moves, and the images in a mirror."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.simulate.render import NOTHING, Figure, TrueImage, draw_figures, first_hits, ray_directions
from anchorpose.simulate.rooms.walls import Mirror

NEARER_THAN_ALL_M: Final = 1e-3  # m, smaller than all real depths, so that pixels with this depth are never overwritten


@dataclass(frozen=True, slots=True, eq=False)
class RoomPicture:
    """A room as one camera sees it, without people and without furniture that moves."""

    camera: Camera
    image: TrueImage  # true image; the mirrored room is as far behind the mirror as the room is in front of it
    mirror: Mirror | None
    in_mirror: np.ndarray  # (height, width) bool, pixels whose ray meets the mirror
    shiny: np.ndarray  # (height, width) bool, pixels whose ray meets bare metal

    def with_movers(self, movers: tuple[Figure, ...], people: tuple[Figure, ...]) -> TrueImage:
        """Return the room with furniture that moves (``movers``), and with the mirror images of this furniture and of
        people. All of these have the room's label.
        """
        image = self.image
        if self.mirror is not None and self.in_mirror.any():
            image = self._with_reflections(self.mirror, (*movers, *people))
        return draw_figures(self.camera, image, movers)

    def _with_reflections(self, mirror: Mirror, figures: tuple[Figure, ...]) -> TrueImage:
        masked = self.image._replace(
            depth_m=np.where(self.in_mirror, self.image.depth_m, np.float32(NEARER_THAN_ALL_M))
        )
        drawn = draw_figures(self.camera, masked, tuple(reflected(mirror, figure) for figure in figures))
        return self.image._replace(
            depth_m=np.where(self.in_mirror, drawn.depth_m, self.image.depth_m),
            cosine=np.where(self.in_mirror, drawn.cosine, self.image.cosine),
        )


def reflected(mirror: Mirror, figure: Figure) -> Figure:
    """Return the mirror image of a figure, labelled as the room. Triangles behind the mirror's plane are left out."""
    before = mirror.before_m(figure.skin_m) > 0.0
    kept = before[figure.faces].all(axis=1) if len(figure.faces) else np.zeros(0, dtype=bool)
    faces = figure.faces[kept]
    return Figure(mirror.reflect(figure.skin_m).astype(np.float32), faces, np.zeros(len(faces), np.uint8), NOTHING)


def take_picture(camera: Camera, triangles: np.ndarray, shiny: np.ndarray, mirror: Mirror | None) -> RoomPicture:
    """Render everything in a room that never moves. triangles (n, 3, 3): world metres; shiny (n,) bool: triangles of
    bare metal.
    """
    shape = (camera.height, camera.width)
    directions = ray_directions(camera)
    glass = np.zeros((0, 3, 3)) if mirror is None else mirror.triangles
    all_triangles = np.concatenate([triangles, glass]).astype(np.float32)
    origins = np.tile(camera.position_m.astype(np.float32), (len(directions), 1))
    hit, distance, normal = first_hits(origins, directions, all_triangles)
    on_glass = hit >= len(triangles)
    if mirror is not None and on_glass.any():
        start = (origins + distance[:, None] * directions)[on_glass]
        turned = _turned_back(mirror, directions[on_glass])
        second, farther, beyond = first_hits(start, turned, triangles.astype(np.float32))
        hit[on_glass], normal[on_glass] = second, mirror.reflect(beyond + mirror.point_m) - mirror.point_m
        distance[on_glass] = np.where(second >= 0, distance[on_glass] + farther, 0.0)
    found = (hit >= 0) & camera.valid_pixels().ravel()
    length = np.linalg.norm(normal, axis=1) * np.linalg.norm(directions, axis=1)
    cosine = np.abs((normal * directions).sum(axis=1)) / np.where(found & (length > 0), length, 1.0)
    image = TrueImage(
        depth_m=np.where(found, distance, 0.0).astype(np.float32).reshape(shape),
        cosine=np.where(found, cosine, 1.0).astype(np.float32).reshape(shape),
        label=np.zeros(shape, np.uint8),
        part=np.zeros(shape, np.uint8),
    )
    metal = found & shiny[np.clip(hit, 0, len(shiny) - 1)] & ~on_glass
    return RoomPicture(camera, image, mirror, on_glass.reshape(shape), metal.reshape(shape))


def _turned_back(mirror: Mirror, directions: np.ndarray) -> np.ndarray:
    """Return ray directions (n, 3) float32 after reflection in the mirror."""
    along = directions @ mirror.normal
    return np.asarray(directions - 2.0 * along[:, None] * mirror.normal, dtype=np.float32)
