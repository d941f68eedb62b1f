"""What a first pose must be to be believed."""

from __future__ import annotations

import numpy as np
import pytest

from anchorpose.body.learning import shape_of_height, standing_height
from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.tracker.start import is_human

ASSET = body_points().asset


@pytest.mark.parametrize("height_m", [1.45, 1.7, 2.0])
def test_adults_are_human(height_m):
    assert is_human(shape_of_height(ASSET, height_m))


def test_half_a_person_is_not():
    """The upper half of one who sits, taken for the whole of a small person."""
    small = shape_of_height(ASSET, 1.45)
    while standing_height(ASSET, small)[0] > 1.3:
        small = FittedShape(small.coefficients * 1.1, small.clothing_m)
    assert not is_human(small)
    assert np.isfinite(small.coefficients).all()
