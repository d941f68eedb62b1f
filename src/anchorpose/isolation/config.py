"""The settings of isolation."""

from __future__ import annotations

from anchorpose.settings import Positive, settings


@settings
class IsolationConfig:
    """How far people reach, and how closely their skin follows its prediction."""

    reach_m: Positive = 0.90  # from the body's axis to an outstretched hand
    skin_sigma_m: Positive = 0.02  # clothes and shape, for the patient's predicted skin
