"""What may be set about the body: how it is registered and learnt, and when a joint counts as seen."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from anchorpose.settings import Count, Positive, settings


class Source(StrEnum):
    """What proposes other poses where one is in doubt, and casts that doubt (``body.proposals``)."""

    SURFACE = "surface"  # skin that nothing covers
    ANCHORS = "anchors"  # hands, feet and free ends that the geodesic distances find
    DESCRIPTOR = "descriptor"  # the learnt one
    SIDES = "sides"  # limbs exchanged, or the body turned round; casts no doubt of its own


@settings
class RegistrationConfig:
    """How one frame is registered."""

    reaches_m: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.12, 0.10, 0.07, 0.06)
    """Of each step: from a fast arm's surprise to clothes."""

    held_steps: Annotated[int, Field(ge=0, strict=True)] = 2
    """Steps with the pairs and anchors, which are centimetres off: they start the registration, they do not end it."""

    least_nodes: Count = 150  # of about 3,500: fewer are a hand in the image, not a patient
    node_count: Count = 2500  # enough for 60 parameters; more only cost time
    surface_sigma_m: Positive = 0.010  # clothes and sensor together
    rows_per_observation: Positive = 8.0  # neighbouring nodes share their error: so many count as one
    sources: tuple[Source, ...] = tuple(Source)  # of other poses where one is in doubt; fewer only to compare


@settings
class LearningConfig:
    """How much of the recording the shape is learnt from."""

    own_shape: bool = True  # False: nothing is learnt, everybody is the mean adult of the given or seen height
    window_s: Positive = 4.0  # a patient moves enough in it to show where the limbs turn
    longest_s: Positive = 30.0  # of all stretches together: more makes no difference, and every second is tracked twice
    frame_count: Count = 12  # spread over the window; more frames show the same again
    height_sigma_m: Positive = 0.01  # of a measured height: with or without shoes, in the morning or the evening


@settings
class VisibilityConfig:
    """When skin counts as seen."""

    reach_m: Positive = 0.04  # between skin and depth: clothes, sensor and pose error together


@settings
class UncertaintyConfig:
    """What the linear posterior does not know, set on simulated people alone and in clinics (see docs/tracking.md)."""

    floor_m: Positive = 0.0035  # joints lie inside the body; the learnt shape places them no better than this
    inflation: Positive = 0.65  # of the posterior: rows_per_observation is cautious, neighbours are less alike
