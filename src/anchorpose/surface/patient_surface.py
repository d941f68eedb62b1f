"""One frame's labelled pictures to the patient's surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.contacts import ContactConfig, cut_contacts
from anchorpose.surface.expected_skin import ExpectedSkin
from anchorpose.surface.fusion import FusionConfig, fuse
from anchorpose.surface.hidden import HiddenConfig, add_hidden_skin
from anchorpose.surface.joins import join_pieces, join_rest
from anchorpose.surface.mesh import SheetConfig, build_surface
from anchorpose.surface.skin_under import SkinUnderConfig, find_contested, show_skin
from anchorpose.surface.surface import Surface


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
