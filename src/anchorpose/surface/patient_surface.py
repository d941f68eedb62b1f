"""One frame's labelled pictures to the patient's surface.

Links between pieces that the depth edges cut apart although the body is one: a chin before the neck.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import KDTree

from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.contacts import ContactConfig, cut_contacts
from anchorpose.surface.fusion import FusionConfig, fuse
from anchorpose.surface.hidden import HiddenConfig, add_hidden_skin
from anchorpose.surface.links import add_links, straight_m
from anchorpose.surface.mesh import SheetConfig, build_surface, pieces
from anchorpose.surface.skin_under import SkinUnderConfig, find_contested, show_skin
from anchorpose.surface.surface import ExpectedSkin, Surface

FORWARD = ((0, 1), (-1, 1), (-1, 0), (-1, -1))
"""Row and column offset of ring places E, NE, N, NW: every pair of grid neighbours once."""

SPREAD = 1.5  # the seam is where the jump is within half of its smallest; elsewhere the pieces merely overlap


def join_pieces(surface: Surface, step: int, max_gap_m: float) -> Surface:
    """One camera's surface, on the grid of every ``step``-th pixel, with its pieces joined where they come nearest.

    Pieces that show known skin count as one: hidden skin joins them better than the shortest way would.
    """
    piece = pieces(surface)
    known = np.unique(piece[surface.skin >= 0])
    if len(known):
        piece = np.where(np.isin(piece, known), known[0], piece)
    if len(piece) == 0 or (piece == piece[0]).all():
        return surface
    index = np.full(surface.pixel.max(axis=0) // step + 1, -1, np.int32)
    index[surface.pixel[:, 0] // step, surface.pixel[:, 1] // step] = np.arange(len(surface))
    seams = join_pairs(index, surface.points_m, piece, max_gap_m)
    start, node, length = add_links(surface, seams, straight_m(surface.points_m, seams), len(surface))
    return replace(surface, link_start=start, link_node=node, link_length_m=length)


def join_rest(surface: Surface, max_gap_m: float) -> Surface:
    """The surface with seen pieces that nothing joins to the largest linked to it where they are nearest.

    At most ``max_gap_m`` wide; what is farther off stays apart, and its distances inf.
    """
    seen = surface.seen_count
    if seen == 0:
        return surface
    piece = pieces(surface)
    size = np.bincount(piece[:seen], minlength=piece.max() + 1)
    rest = np.setdiff1d(piece[:seen], size.argmax())
    if len(rest) == 0:
        return surface
    main = np.flatnonzero(piece == size.argmax())
    tree = KDTree(surface.points_m[main])
    pairs = []
    for number in rest:
        own = np.flatnonzero(piece == number)
        away, nearest = tree.query(surface.points_m[own])
        if away.min() <= max_gap_m:
            pairs.append([own[away.argmin()], main[nearest[away.argmin()]]])
    added = np.array(pairs, np.int32).reshape(-1, 2)
    start, node, length = add_links(surface, added, straight_m(surface.points_m, added), len(surface))
    return replace(surface, link_start=start, link_node=node, link_length_m=length)


def join_pairs(index: np.ndarray, points_m: np.ndarray, piece: np.ndarray, max_gap_m: float) -> np.ndarray:
    """Pairs of grid neighbours that join pieces of surface into one where they come nearest, at most ``max_gap_m``.

    index (rows, cols) int32: node on the grid, -1 = none; points_m (n, 3); piece (n,) int32 of ``pieces``. Two pieces
    are joined once, by the shortest way (Kruskal's rule), so that an arm before the trunk stays apart from it as long
    as the shoulder holds it. Returns (m, 2) int32.
    """
    pair = _seams(index, piece)
    gap = np.linalg.norm(points_m[pair[:, 0]] - points_m[pair[:, 1]], axis=1)
    pair, gap = pair[gap <= max_gap_m], gap[gap <= max_gap_m]
    sides = np.sort(piece[pair], axis=1)
    merged = np.arange(piece.max(initial=-1) + 1)
    chosen = np.zeros(len(pair), bool)
    for place in np.argsort(gap, kind="stable"):
        one, two = sides[place]
        if merged[one] != merged[two]:
            merged[merged == merged[two]] = merged[one]
            chosen |= (sides == sides[place]).all(axis=1) & (gap <= SPREAD * gap[place])
    return pair[chosen].astype(np.int32)


def _seams(index: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """(k, 2) grid neighbours on different pieces."""
    rows, cols = index.shape
    found = []
    for down, right in FORWARD:
        here = index[max(0, -down) :, max(0, -right) : cols - max(0, right)]
        there = index[: rows + down, max(0, right) : cols + min(0, right)]
        both = (here >= 0) & (there >= 0)
        pair = np.stack([here[both], there[both]], axis=1)
        found.append(pair[piece[pair[:, 0]] != piece[pair[:, 1]]])
    return np.concatenate(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceConfig:
    """From labelled pictures to one surface, step by step."""

    by_body: bool = True  # cut and closed by the body that is expected; False: what the pictures show, as in the paper
    sheet: SheetConfig = field(default_factory=SheetConfig)
    skin_under: SkinUnderConfig = field(default_factory=SkinUnderConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)
    fusion: FusionConfig = field(default_factory=FusionConfig)
    hidden: HiddenConfig = field(default_factory=HiddenConfig)


def patient_surface(
    views: Sequence[View], cameras: Sequence[Camera], expected: ExpectedSkin | None = None,
    config: SurfaceConfig | None = None,
) -> Surface:  # fmt: skip
    """The patient's surface of one frame: seen nodes of all cameras, then hidden skin where his body is expected.

    views: one a camera, in the order of the cameras; a blank one for a camera without a picture. expected: his
    predicted skin; without it bars are bridged and pieces joined by their planes and distances, nothing is cut, and
    nothing hidden is added.
    """
    config = config or SurfaceConfig()
    expected = expected if config.by_body else None
    contested = None if expected is None else find_contested(expected, config.skin_under)
    sheets = [_sheet(view, camera, expected, contested, config) for view, camera in zip(views, cameras, strict=True)]
    surface = fuse(sheets, cameras, expected, config.fusion)
    if expected is None:
        return surface
    whole = add_hidden_skin(surface, expected, [view.depth_m for view in views], cameras, config.hidden)
    return join_rest(whole, config.sheet.max_join_m)


def _sheet(
    view: View, camera: Camera, expected: ExpectedSkin | None, contested: np.ndarray | None, config: SurfaceConfig
) -> Surface:
    """What one camera sees of him."""
    if expected is None or contested is None:
        sheet = build_surface(view.depth_m, view.patient, camera, config.sheet, view.hidden_by_equipment)
    else:
        sheet = build_surface(view.depth_m, view.patient, camera, config.sheet)
        sheet = cut_contacts(show_skin(sheet, camera, expected, contested, config.skin_under), expected, config.contact)
    return join_pieces(sheet, config.sheet.step, config.sheet.max_join_m)


def blank_view(camera: Camera) -> View:
    """What a camera without a picture shows: nothing."""
    shape = camera.height, camera.width
    return View(np.zeros(shape, np.float32), np.full(shape, PixelLabel.NO_READING, np.uint8))
