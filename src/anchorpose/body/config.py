"""Hold the settings of registration and learning of the body, and of when a joint counts as seen."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from anchorpose.settings import Count, Positive, settings


class Source(StrEnum):
    """A source of other poses to try when a pose is in doubt (``body.proposals``). All sources except the last also
    raise such doubts.
    """

    SURFACE = "surface"  # seen skin that no part of the posed body covers
    ANCHORS = "anchors"  # hands, feet and free ends of limbs, found by geodesic distances
    DESCRIPTOR = "descriptor"  # the learnt descriptor, which names places on the body
    # left and right limbs exchanged, or the body facing the other way; this source raises no doubts itself
    SIDES = "sides"


@settings
class RegistrationConfig:
    """Settings of the body's registration to one frame."""

    reaches_m: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.12, 0.10, 0.07, 0.06)
    """Maximum distance, in metres, at which a node pulls the skin, for each step. The first value is the prediction
    error of a fast arm, the last value is the thickness of clothes."""

    held_steps: Annotated[int, Field(ge=0, strict=True)] = 2
    """Number of first steps in which matches and anchors also pull. They have errors of centimetres, so later steps use
    only the surface.
    """

    # minimum number of nodes for a registration; a patient has about 3,500, a hand alone has fewer
    least_nodes: Count = 150
    node_count: Count = 2500  # maximum number of nodes used; for 60 parameters this is enough, and more only cost time
    # m, standard deviation of a node's distance from the skin, due to clothes and the sensor's error
    surface_sigma_m: Positive = 0.010
    # number of neighbouring nodes that count as one observation, since they share errors
    rows_per_observation: Positive = 8.0
    # sources of alternatives to a pose in doubt; use fewer only for a comparison
    sources: tuple[Source, ...] = tuple(Source)


@settings
class LearningConfig:
    """Settings of learning the shape."""

    own_shape: bool = True  # whether the shape is learnt; False = use the mean adult of the given or visible height
    # s, length of a window of frames that are used together; in this time patients move enough to show where limbs bend
    window_s: Positive = 4.0
    longest_s: Positive = 30.0  # s, total time to learn from; more changes nothing, and every second is tracked twice
    frame_count: Count = 12  # number of frames of the first window that the fit uses; more frames repeat the evidence
    height_sigma_m: Positive = 0.01  # m, error of a measured height, which depends on shoes and the time of day


@settings
class VisibilityConfig:
    """Settings of when skin counts as seen."""

    # m, maximum gap between seen skin and its reading, due to clothes and to errors of sensor and pose
    reach_m: Positive = 0.04


@settings
class UncertaintyConfig:
    """Corrections of the posterior's sigma, set on simulated people alone and in clinics (see docs/tracking.md)."""

    # m, minimum sigma of a joint, since joints lie inside the body, and the learnt shape is not more accurate
    floor_m: Positive = 0.0035
    # factor on the posterior's sigma; below 1, since neighbouring nodes share less error than assumed
    inflation: Positive = 0.65
