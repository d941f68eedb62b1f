"""The settings of isolation."""

from __future__ import annotations

from anchorpose.settings import Positive, settings


@settings
class IsolationConfig:
    """How large people are, and how closely their skin follows its prediction."""

    person_radius_m: Positive = 0.25  # half a shoulder breadth (95th percentile of men 0.26 m)
    reach_m: Positive = 0.90  # from the body's axis to an outstretched hand
    skin_sigma_m: Positive = 0.02  # clothes and shape, for the patient's predicted skin
    prediction_growth_m: Positive = 0.04  # added for each frame without a fit: 1.2 m/s at 30 Hz, a fast leg
