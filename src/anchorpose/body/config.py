"""Hold the settings of the body: how it is registered and learnt, and when a joint counts as seen."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from anchorpose.settings import Count, Positive, settings


class Source(StrEnum):
    """A source of alternatives to a pose in doubt; all sources but the last can also raise the doubt
    (``body.proposals``).
    """

    SURFACE = "surface"  # seen skin that no part of the posed body covers
    ANCHORS = "anchors"  # hands, feet and free ends that the geodesic distances find
    DESCRIPTOR = "descriptor"  # the learnt descriptor, which names places on the body
    SIDES = "sides"  # limbs exchanged, or the body turned round; does not raise a doubt itself


@settings
class RegistrationConfig:
    """Settings of the body's registration to one frame."""

    reaches_m: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.12, 0.10, 0.07, 0.06)
    """Metres, one per step: within this distance a node pulls the skin. It begins with the prediction error of a fast
    arm and ends with the thickness of clothes."""

    held_steps: Annotated[int, Field(ge=0, strict=True)] = 2
    """Number of first steps in which matches and anchors also pull. They are centimetres off, so they only help to
    begin the registration; the surface alone ends it.
    """

    least_nodes: Count = 150  # nodes needed for a registration; a patient has about 3,500, a hand has fewer than this
    node_count: Count = 2500  # nodes used at most: enough for 60 parameters; more only cost time
    surface_sigma_m: Positive = 0.010  # m; standard deviation of a node about the skin, from clothes and sensor
    rows_per_observation: Positive = 8.0  # neighbouring nodes that count as one observation, since they share errors
    # sources of alternatives to a pose in doubt; use fewer only for a comparison
    sources: tuple[Source, ...] = tuple(Source)


@settings
class LearningConfig:
    """Settings of how the shape is learnt, and from how much of the recording."""

    own_shape: bool = True  # False: no shape is learnt; the body is the mean adult of the given or seen height
    # s, length of a window that is learnt from at once; patients move enough in it to show where limbs turn
    window_s: Positive = 4.0
    longest_s: Positive = 30.0  # s, in all stretches together; more changes nothing, and every second is tracked twice
    frame_count: Count = 12  # frames of the first window that the fit uses; more frames repeat the evidence
    height_sigma_m: Positive = 0.01  # m; error of a measured height, which depends on shoes and the time of day


@settings
class VisibilityConfig:
    """Settings of when skin counts as seen."""

    reach_m: Positive = 0.04  # m between skin and reading; clothes, sensor and pose error together reach this


@settings
class UncertaintyConfig:
    """Corrections of the linear posterior, set on simulated people alone and in clinics (see docs/tracking.md)."""

    # m, smallest sigma; joints lie inside the body, and the learnt shape is not more accurate
    floor_m: Positive = 0.0035
    inflation: Positive = 0.65  # factor on the posterior's sigma; neighbouring nodes share less error than assumed
