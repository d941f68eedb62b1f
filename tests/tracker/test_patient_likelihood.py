"""The likelihood of the patient's predicted skin: as wide as its uncertainty; limbs that may be anywhere have none."""

import numpy as np
from body_builder import adult_body, points, standing

from anchorpose.body.skin_map import map_body
from anchorpose.body.skin_points import pose_points
from anchorpose.isolation.view import PixelLabel
from anchorpose.surface.surface import ExpectedSkin
from anchorpose.tracker.bystanders import GROWTH_M_S, SKIN_SIGMA_M
from anchorpose.tracker.observation import Expectation
from anchorpose.tracker.observing import LOOSEST_SKIN_M, UNFITTED_M_S, patient_likelihood

BODY = adult_body()
A_FRAME_S = 1.0 / 15.0


def expectation(sigma_m: np.ndarray, unfitted_s: float = 0.0) -> Expectation:
    posed = pose_points(BODY, standing())
    skin = ExpectedSkin(posed.points_m.astype(np.float32), posed.normals.astype(np.float32), map_body(BODY))
    return Expectation(skin, sigma_m, np.zeros((5, 3)), np.array([1.0, 0.0, 0.0]), unfitted_s)


def test_the_spread_is_the_uncertainty_of_the_skin() -> None:
    sigma = np.linspace(0.0, 0.9 * LOOSEST_SKIN_M, len(points().part))
    likelihood, hidden = patient_likelihood(expectation(sigma, 0.1), -A_FRAME_S)
    spread = SKIN_SIGMA_M + A_FRAME_S * GROWTH_M_S + 0.1 * UNFITTED_M_S
    np.testing.assert_allclose(likelihood.sigma_m, np.hypot(spread, sigma), rtol=1e-6)
    assert (likelihood.owner == PixelLabel.PATIENT).all()
    assert not len(hidden.part)


def test_a_limb_that_may_be_anywhere_has_no_likelihood() -> None:
    shank = points().part == points().asset.bone("RightLeg")
    expected = expectation(np.where(shank, 1.01 * LOOSEST_SKIN_M, 0.005))
    likelihood, hidden = patient_likelihood(expected, A_FRAME_S)
    np.testing.assert_array_equal(likelihood.points_m, expected.skin.points_m[~shank])
    np.testing.assert_array_equal(hidden.points_m, expected.skin.points_m[shank])
    assert len(np.unique(hidden.part)) == 1
