"""One frame's labelled depth images to the patient's surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.contacts import cut_contacts
from anchorpose.surface.fusion import fuse
from anchorpose.surface.hidden import add_hidden_skin, assign_skin, find_ambiguous_skin
from anchorpose.surface.joins import join_pieces, join_rest
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.surface import ExpectedSkin, Surface, SurfaceConfig
from anchorpose.threads import each


def patient_surface(
    views: Sequence[View],
    cameras: Sequence[Camera],
    expected: ExpectedSkin | None = None,
    config: SurfaceConfig | None = None,
) -> Surface:
    """The patient's surface of one frame: seen nodes of all cameras, then hidden skin where the body is expected.

    views: one per camera, in the order of the cameras; a blank one for a camera without a depth frame. expected: the
    patient's predicted skin; without it bars are bridged and pieces joined by their planes and distances, nothing is
    cut, and nothing hidden is added.
    """
    config = config or SurfaceConfig()
    if expected is None or not config.by_body:
        bridged = each(lambda view, camera: _bridged_mesh(view, camera, config), views, cameras)
        return fuse(bridged, cameras, None, config)
    ambiguous = find_ambiguous_skin(expected)
    meshes = each(lambda view, camera: _cut_mesh(view, camera, expected, ambiguous, config), views, cameras)
    surface = fuse(meshes, cameras, expected, config)
    whole = add_hidden_skin(surface, expected, [view.depth_m for view in views], cameras)
    return join_rest(whole, config.max_join_m)


def _bridged_mesh(view: View, camera: Camera, config: SurfaceConfig) -> Surface:
    """What one camera sees of the patient, joined across what hides them."""
    mesh = build_surface(view.depth_m, view.patient, camera, config, view.hidden_by_equipment)
    return join_pieces(mesh, config.step, config.max_join_m)


def _cut_mesh(
    view: View, camera: Camera, expected: ExpectedSkin, ambiguous: np.ndarray, config: SurfaceConfig
) -> Surface:
    """What one camera sees of the patient, cut where parts of the expected body touch."""
    mesh = build_surface(view.depth_m, view.patient, camera, config)
    mesh = cut_contacts(assign_skin(mesh, camera, expected, ambiguous), expected)
    return join_pieces(mesh, config.step, config.max_join_m)


def blank_view(camera: Camera) -> View:
    """What a camera without a depth frame shows: nothing."""
    shape = camera.height, camera.width
    return View(np.zeros(shape, np.float32), np.full(shape, PixelLabel.NO_READING, np.uint8))
