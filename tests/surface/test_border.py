"""Where the patient ends, and where something else cuts the surface."""

import numpy as np
import pytest
from surface_builder import kinect

from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.border import Border, border
from anchorpose.surface.mesh import build_surface

CAMERA = kinect()
LEG = np.s_[20:80, 50:70]


def scene():
    """(depth, labels) of a leg at 2.4 m before a wall at 4 m."""
    depth = np.full((CAMERA.height, CAMERA.width), 4.0, np.float32)
    labels = np.full(depth.shape, PixelLabel.BACKGROUND, np.uint8)
    depth[LEG], labels[LEG] = 2.4, PixelLabel.PATIENT
    return depth, labels


def kinds_by_row(depth, labels):
    """Highest border of the nodes of each mesh row, {row: kind}."""
    surface = build_surface(depth, labels == PixelLabel.PATIENT, CAMERA)
    kind = border(surface, [View(depth, labels)])
    return {int(row): int(kind[surface.pixel[:, 0] == row].max()) for row in np.unique(surface.pixel[:, 0])}


def test_a_silhouette_before_a_wall_a_person_far_behind_and_a_background_that_was_removed_cut_nothing():
    assert set(kinds_by_row(*scene()).values()) == {Border.INSIDE}
    depth, labels = scene()
    behind = labels == PixelLabel.BACKGROUND
    depth[behind], labels[behind] = 3.0, PixelLabel.OTHER_PERSON
    assert set(kinds_by_row(depth, labels).values()) == {Border.INSIDE}
    gone = labels == PixelLabel.BACKGROUND
    depth[gone], labels[gone] = 0.0, PixelLabel.NO_READING
    assert set(kinds_by_row(depth, labels).values()) == {Border.INSIDE}


@pytest.mark.parametrize("label", [PixelLabel.EQUIPMENT, PixelLabel.BACKGROUND, PixelLabel.OTHER_PERSON])
def test_whatever_stands_before_the_shin_cuts_it(label):
    depth, labels = scene()
    depth[60:68, 30:90], labels[60:68, 30:90] = 2.2, label
    kinds = kinds_by_row(depth, labels)
    assert kinds[58] == kinds[68] == Border.CUT
    assert kinds[40] == kinds[78] == Border.INSIDE


def test_a_hand_that_holds_the_shin_cuts_it_though_it_is_no_nearer():
    depth, labels = scene()
    labels[70:80, 45:75] = PixelLabel.OTHER_PERSON
    depth[70:80, 45:75] = 2.42
    kinds = kinds_by_row(depth, labels)
    assert (kinds[68], kinds[40]) == (Border.CUT, Border.INSIDE)


@pytest.mark.parametrize("label", [PixelLabel.EQUIPMENT, PixelLabel.BACKGROUND])
def test_the_floor_under_the_sole_cuts_nothing(label):
    depth, labels = scene()
    below = np.arange(80, CAMERA.height)
    depth[below] = (2.4 - 0.03 * (below - 79))[:, None]  # as seen from 0.5 m above it
    labels[below] = label
    assert kinds_by_row(depth, labels)[78] == Border.INSIDE


def test_a_hole_cuts_and_single_lost_pixels_do_not():
    depth, labels = scene()
    depth[40:56, 52:68], labels[40:56, 52:68] = 0.0, PixelLabel.NO_READING
    depth[70, 60], labels[70, 60] = 0.0, PixelLabel.NO_READING
    kinds = kinds_by_row(depth, labels)
    assert kinds[38] == kinds[56] == Border.CUT
    assert kinds[72] == Border.INSIDE


def test_the_edge_of_the_picture_cuts():
    depth, labels = scene()
    depth[80:, 50:70], labels[80:, 50:70] = 2.4, PixelLabel.PATIENT
    kinds = kinds_by_row(depth, labels)
    assert (kinds[CAMERA.height - 2], kinds[90]) == (Border.CUT, Border.INSIDE)


def test_the_patients_own_arm_in_front_is_distinguished_from_another_persons():
    depth, labels = scene()
    depth[60:70, 30:90], labels[60:70, 30:90] = 2.2, PixelLabel.PATIENT
    kinds = kinds_by_row(depth, labels)
    assert (kinds[58], kinds[40]) == (Border.SELF, Border.INSIDE)
