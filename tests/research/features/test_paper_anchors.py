"""The paper's anchors: extrema by its own rule, named, and none on what hangs on nothing."""

import numpy as np
import pytest
from body_builder import FRONT, adult_body, seen_body, standing

from anchorpose.geodesics.anchors import Anchors, find_anchors
from anchorpose.geodesics.extrema import surface_center
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.research.features.paper_anchors import RADIUS_M, SAME_END_M, by_edges, paper_anchors, paper_descriptor
from anchorpose.surface.mesh import keep_nodes
from anchorpose.surface.surface import Surface

BODY = adult_body()
FOOT = ANCHOR_NAMES.index("FootLeft")


@pytest.fixture(scope="module")
def surface() -> Surface:
    return seen_body(standing(LeftArm=(20.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0)), BODY, (FRONT,)).surface


def named(surface: Surface) -> Anchors:
    height_m = float(np.ptp(BODY.mesh.vertices[:, 1]))
    return find_anchors(surface, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), height_m)


def test_an_anchor_is_farther_from_the_centre_than_all_within_half_a_metre_and_has_the_name_of_its_end(surface) -> None:
    names = named(surface)
    anchors = paper_anchors(surface, names)
    assert anchors.found.all()
    field = by_edges(surface, np.array([surface_center(surface)]))[0]
    around = by_edges(surface, anchors.node) < RADIUS_M
    for node, near in zip(anchors.node, around, strict=True):
        assert (field[near] <= field[node]).all()
    assert (np.linalg.norm(anchors.position_m - names.position_m, axis=1) < SAME_END_M).all()


def test_a_leg_that_is_cut_off_has_no_anchor_and_no_distance(surface) -> None:
    height = surface.points_m[:, 1] - surface.points_m[:, 1].min()
    left = surface.points_m[:, 2] < surface.points_m[:, 2].mean()
    whole = named(surface)
    foot_is_left = left[whole.node[FOOT]]
    cut = keep_nodes(surface, ~((left == foot_is_left) & (height > 0.3) & (height < 0.4)))
    names = named(cut)
    assert names.found[FOOT]
    assert not paper_anchors(cut, names).found[FOOT]
    descriptor = paper_descriptor(cut, names)
    assert np.isnan(descriptor[:, FOOT]).all()
    assert np.isinf(descriptor[names.node[FOOT], :FOOT]).all()


def test_a_surface_of_nothing_has_no_distances(surface) -> None:
    nothing = keep_nodes(surface, np.zeros(len(surface), bool))
    assert paper_descriptor(nothing, named(surface)).shape == (0, len(ANCHOR_NAMES))
