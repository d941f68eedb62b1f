"""What is known of a patient's shape: what adults are like, a measured height, and what frames have shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.skin_points import FittedShape

CLOTHING_MEAN_M: Final = 0.006  # clothes are some millimetres thick
CLOTHING_SIGMA_M: Final = 0.004
MOST_DEVIATIONS: Final = 3.0  # of a coefficient: one adult in a thousand
THICKEST_M: Final = 0.03  # clothes
_HEIGHT_STEPS: Final = 3  # the highest and the lowest vertex may change with the shape


@dataclass(frozen=True, slots=True, eq=False)
class ShapeBelief:
    """The most likely shape, and information (k + 1, k + 1): inverse covariance of its coefficients, then clothing."""

    shape: FittedShape
    information: np.ndarray

    def deviation(self, shape: FittedShape) -> np.ndarray:
        """(k + 1,) how far a shape is from the most likely one."""
        return _vector(shape) - _vector(self.shape)

    def cost(self, shape: FittedShape) -> float:
        """How unlikely a shape is, in units of one observation."""
        away = self.deviation(shape)
        return float(away @ self.information @ away)

    def variance(self, rows: np.ndarray) -> np.ndarray:
        """(n,) variances of quantities that change with the coefficients by rows (n, k)."""
        covariance = np.linalg.inv(self.information)[:-1, :-1]
        return np.asarray(((rows @ covariance) * rows).sum(axis=1))

    def standing(self, asset: BodyAsset, height_m: float, sigma_m: float) -> ShapeBelief:
        """The belief after the patient's standing height was measured (a Kalman update, linearised at each step)."""
        shape, information = self.shape, self.information
        for _ in range(_HEIGHT_STEPS):
            own_m, row = standing_height(asset, shape)
            row = np.append(row, 0.0) / sigma_m
            miss = (height_m - own_m) / sigma_m + row @ self.deviation(shape)
            information = self.information + np.outer(row, row)
            mean = _vector(self.shape) + np.linalg.solve(information, row * miss)
            shape = FittedShape(mean[:-1], float(mean[-1]))
        return ShapeBelief(possible_shape(shape), information)


def adult_belief(asset: BodyAsset) -> ShapeBelief:
    """What is known of an adult before anything is seen: each coefficient has a standard deviation of one."""
    mean = FittedShape(np.zeros(asset.shape_count), CLOTHING_MEAN_M)
    return ShapeBelief(mean, np.diag(np.append(np.ones(asset.shape_count), 1.0 / CLOTHING_SIGMA_M**2)))


def possible_shape(shape: FittedShape) -> FittedShape:
    """The shape, held within what adults and their clothes can be: bad depth must not make a giant."""
    return FittedShape(
        np.clip(shape.coefficients, -MOST_DEVIATIONS, MOST_DEVIATIONS),
        float(np.clip(shape.clothing_m, 0.0, THICKEST_M)),
    )


def standing_height(asset: BodyAsset, shape: FittedShape) -> tuple[float, np.ndarray]:
    """Height in metres of the body at rest, without clothes, and its derivative (k,) by the coefficients."""
    up = shape.body(asset).vertices[:, 1]
    top, bottom = up.argmax(), up.argmin()
    count = len(shape.coefficients)
    row = asset.vertex_basis[:count, top, 1] - asset.vertex_basis[:count, bottom, 1]
    return float(up[top] - up[bottom]), row


def _vector(shape: FittedShape) -> np.ndarray:
    return np.append(shape.coefficients, shape.clothing_m)
