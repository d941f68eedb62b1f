"""What isolation may be told."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True, kw_only=True)
class IsolationConfig:
    """Each default with its reason; gates are in standard deviations of the measured sensor noise."""

    background_gate: float = 2.0  # applied to a 3x3 median, whose deviation is 0.4 of a pixel's: five of its sigmas
    equipment_gate: float = 3.0  # a bar is told from skin by one pixel, not by a median: thin bars are 3 pixels wide
    equipment_tolerance_m: float = 0.01  # the equipment was measured by hand, and its pose was estimated
    jump_gate: float = 4.0  # neighbours on one surface differ by noise and by slope, and by no more than this noise
    steepest_slope_rad: float = 1.40  # 80 degrees: steeper surfaces give a depth camera no reading
    person_radius_m: float = 0.25  # half a shoulder breadth (95th percentile of men 0.26 m)
    reach_m: float = 0.90  # from the body's axis to an outstretched hand
    person_height_m: float = 0.50  # what must be seen of a person, from top to bottom: half of one who sits
    person_area_m2: float = 0.12  # what must be seen of a person: a fifth of an adult's frontal area
    crumb_area_m2: float = 0.0005  # a piece smaller than a finger's end is nobody
    trunk_radius_m: float = 0.15  # half a trunk's depth and some clothes: what stands there is this person
    claim_gate: float = 3.0  # sigmas: skin farther from where it is expected is not claimed, it has to grow
    least_lead: float = 2.0  # squared deviations by which a claim must be stronger than its rivals
    crease_cost: float = 4.0  # steps over the surface for each deviation of the noise that a valley is deep
    memory_sigma_m: float = 0.012  # noise and half the spacing of remembered points
    memory_speed_m_s: float = 0.30  # of skin between frames: people who hold or stand; who walks grows
    memory_s: float = 1.0  # for which hidden skin is remembered: somebody crosses in front of it
    skin_sigma_m: float = 0.02  # clothes and shape, for the patient's predicted skin
    loosest_claim_m: float = 0.05  # half of a limb's width: skin whose place is known no better claims none
    cluster_gap_m: float = 0.10  # a bar with its margins: a head over a rail is still its owner's
    other_surface_m2: float = 0.25  # of a person's skin, seen by all cameras together: more than an arm, 0.15
    own_column: float = 0.5  # of a column beside the patient's: where so much of his skin was expected, it is his
    detached_m: float = 0.12  # a bar's width, and what a forearm moves behind it unseen
    prediction_growth_m: float = 0.04  # added for each frame without a fit: 1.2 m/s at 30 Hz, a fast leg

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not getattr(self, entry.name) > 0:
                raise ValueError(f"{entry.name} must be positive, got {getattr(self, entry.name)}")
        if self.steepest_slope_rad >= 1.57:
            raise ValueError(f"steepest_slope_rad must stay below a right angle, got {self.steepest_slope_rad}")
