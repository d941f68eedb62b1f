"""What is known of a patient's shape: what adults are like, a measured height, and what frames have shown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.skin_points import FittedShape

_HEIGHT_STEPS = 3  # the highest and the lowest vertex may change with the shape


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapePrior:
    """Adults vary by one in each coefficient; clothes are some millimetres thick."""

    clothing_mean_m: float = 0.006
    clothing_sigma_m: float = 0.004
    height_sigma_m: float = 0.01  # of a measured height: with or without shoes, in the morning or the evening

    most_deviations: float = 3.0  # of a coefficient: one adult in a thousand
    thickest_m: float = 0.03

    def possible(self, shape: FittedShape) -> FittedShape:
        """The shape, held within what adults and their clothes can be: bad depth must not make a giant."""
        return FittedShape(
            np.clip(shape.coefficients, -self.most_deviations, self.most_deviations),
            float(np.clip(shape.clothing_m, 0.0, self.thickest_m)),
        )

    def belief(self, asset: BodyAsset, height_m: float | None = None) -> ShapeBelief:
        """What is known before anything is seen, with the standing height where somebody measured it."""
        count = asset.shape_count
        mean = FittedShape(np.zeros(count), self.clothing_mean_m)
        adult = ShapeBelief(mean, np.diag(np.append(np.ones(count), 1.0 / self.clothing_sigma_m**2)), self)
        return adult if height_m is None else adult.standing(asset, height_m)


@dataclass(frozen=True, slots=True, eq=False)
class ShapeBelief:
    """The most likely shape, and information (k + 1, k + 1): inverse covariance of its coefficients, then clothing."""

    shape: FittedShape
    information: np.ndarray
    prior: ShapePrior

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

    def standing(self, asset: BodyAsset, height_m: float) -> ShapeBelief:
        """The belief after the patient's standing height was measured (a Kalman update, linearised anew each step)."""
        shape, information = self.shape, self.information
        for _ in range(_HEIGHT_STEPS):
            own_m, row = standing_height(asset, shape)
            row = np.append(row, 0.0) / self.prior.height_sigma_m
            miss = (height_m - own_m) / self.prior.height_sigma_m + row @ self.deviation(shape)
            information = self.information + np.outer(row, row)
            mean = _vector(self.shape) + np.linalg.solve(information, row * miss)
            shape = FittedShape(mean[:-1], float(mean[-1]))
        return ShapeBelief(self.prior.possible(shape), information, self.prior)


def standing_height(asset: BodyAsset, shape: FittedShape) -> tuple[float, np.ndarray]:
    """Height in metres of the body at rest, without clothes, and its derivative (k,) by the coefficients."""
    up = shape.body(asset).vertices[:, 1]
    top, bottom = up.argmax(), up.argmin()
    count = len(shape.coefficients)
    row = asset.vertex_basis[:count, top, 1] - asset.vertex_basis[:count, bottom, 1]
    return float(up[top] - up[bottom]), row


def _vector(shape: FittedShape) -> np.ndarray:
    return np.append(shape.coefficients, shape.clothing_m)
