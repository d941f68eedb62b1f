"""The body that is fitted beforehand is fitted as in tracking, so that what it compiles is what tracking needs."""

import numpy as np

from anchorpose.tracker.warm_up import warm_up


def test_a_body_that_is_fitted_to_its_own_skin_stays_where_it_is() -> None:
    found = warm_up()
    assert found.found
    assert found.explained > 0.9
    assert np.linalg.norm(found.belief.pose.root_m) < 0.02
