"""The patient's body for run.json: lengths, how sure they are, and how much more frames changed them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.bone_lengths import bone_lengths
from anchorpose.body.shape_belief import ShapeBelief, standing_height


@dataclass(frozen=True, slots=True)
class BoneRecord:
    """A bone from joint to joint, the same in every frame; refined_m: by how much later windows changed it."""

    bone: str
    length_m: float
    sigma_m: float
    refined_m: float


@dataclass(frozen=True, slots=True)
class BodyRecord:
    """The body that was tracked with, and how long it was learnt from. Each sigma is that of the fit's own equations.

    They know of noise, of poses and of what was hidden, but not of clothes and bodies unlike those of the shape space.
    """

    learnt_from_s: float
    height_m: float  # standing, without clothes and shoes
    height_sigma_m: float
    clothing_m: float
    bones: tuple[BoneRecord, ...]
    coefficients: tuple[float, ...]  # of the body asset's shape space


def record_body(asset: BodyAsset, belief: ShapeBelief, first: ShapeBelief, seconds: float) -> BodyRecord:
    """belief: what is known of the shape in the end; first: after the first window."""
    height_m, row = standing_height(asset, belief.shape)
    return BodyRecord(
        learnt_from_s=seconds,
        height_m=height_m,
        height_sigma_m=float(np.sqrt(belief.variance(row[None])[0])),
        clothing_m=belief.shape.clothing_m,
        bones=tuple(
            BoneRecord(now.bone, now.length_m, now.sigma_m, now.length_m - before.length_m)
            for now, before in zip(bone_lengths(asset, belief), bone_lengths(asset, first), strict=True)
        ),
        coefficients=tuple(belief.shape.coefficients.tolist()),
    )
