"""Define the settings for registering and learning a body, for deciding whether its skin is seen, and for the sigma
(standard deviation) of joints.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from anchorpose.settings import Count, Positive, settings


class Source(StrEnum):
    """A source of other poses, which are tried if a pose is in doubt, that is, may be wrong (``body.proposals``). The
    first three sources also serve to detect that a pose is in doubt.
    """

    SURFACE = "surface"  # seen skin that no part of the posed body covers
    # ends of limbs, which are found by distances along the seen surface; not every end is identified as a particular
    # hand or foot
    ANCHORS = "anchors"
    DESCRIPTOR = "descriptor"  # the learnt descriptor: the place on the body that a network predicts for each pixel
    SIDES = "sides"  # left and right limbs exchanged, or the body turned round
    # a hidden limb in a usual posture: as expected from all other bones, or like the other arm or leg
    HIDDEN = "hidden"


@settings
class RegistrationConfig:
    """Settings of registration, which fits a body's posed skin to the nodes of the surface seen in one frame."""

    reaches_m: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.12, 0.10, 0.07, 0.06)
    """Maximum distance (m) at which a node of the surface pulls the skin towards itself, one value per solver step.
    This distance decreases from the prediction error of a fast arm to the thickness of clothes."""

    held_steps: Annotated[int, Field(ge=0, strict=True)] = 2
    """Number of solver steps, counted from the first, in which the skin is also pulled by anchors (head, hands and feet
    found in the frame) and by nodes that the track tree matched between frames. Anchors and matches have errors of
    centimetres, so later steps use only the surface."""

    # minimum number of nodes (seen points of the patient's skin) for a registration; a whole patient has about 3,500
    # nodes, a hand alone has fewer than this minimum
    least_nodes: Count = 150
    # maximum number of nodes used in a registration; this number is enough to find the ``POSE_SIZE`` parameters of a
    # pose, and more nodes would only cost time
    node_count: Count = 2500
    # m, standard deviation of a node's distance from the posed skin, due to clothes and the sensor's error
    surface_sigma_m: Positive = 0.010
    # number of neighbouring nodes that count as one observation, since neighbours share errors
    rows_per_observation: Positive = 8.0
    # sources of other poses for a pose in doubt; by default all sources are used, but a comparison of methods may leave
    # sources out
    sources: tuple[Source, ...] = tuple(Source)


@settings
class LearningConfig:
    """Settings of learning the patient's body shape."""

    own_shape: bool = True  # whether the shape is learnt; False = use the mean adult of the given or visible height
    # s, length of a time window whose frames are fitted together; in this time, patients move enough to show where
    # limbs bend
    window_s: Positive = 4.0
    # s, total duration of the frames from which the shape is learnt; more frames do not improve the shape. After
    # learning, the frames from which the shape was learnt are tracked again
    longest_s: Positive = 30.0
    # maximum number of frames that are fitted in the first time window (``window_s``); more frames would only repeat
    # poses; in each later window, at most half as many frames are fitted
    frame_count: Count = 12
    height_sigma_m: Positive = 0.01  # m, sigma of the measured standing height, which varies with shoes and time of day


@settings
class VisibilityConfig:
    """Setting that decides whether a point of the posed skin counts as seen."""

    # m, maximum depth difference between a seen skin point and the reading at its pixel; errors of sensor and pose, and
    # clothes, cause such differences
    reach_m: Positive = 0.04


@settings
class UncertaintyConfig:
    """Corrections of each joint's sigma (standard deviation), which is computed from the posterior covariance of the
    pose. The corrections were tuned on simulated people, alone or in clinics.
    """

    # m, minimum sigma of a joint: joints lie inside the body, and the learnt shape does not place them better than this
    floor_m: Positive = 0.0035
    # factor by which the sigma that follows from the posterior covariance is multiplied; below 1, since the errors of
    # neighbouring nodes are less similar than registration assumes
    inflation: Positive = 0.65
