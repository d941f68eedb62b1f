"""Describe the prior knowledge of a person's body shape, and the belief in the shape after observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.linalg import block_diag

from anchorpose.body.asset import BodyAsset
from anchorpose.body.kinematics import shape_body
from anchorpose.body.segments import END_SIGMA, GIRTH_SIGMA, LENGTH_SIGMA, SIDES
from anchorpose.body.shape_rows import FreeShape
from anchorpose.body.skin_points import CLOTHES, OFFSETS, PATCHES, FittedShape, even_clothes, skin_points
from anchorpose.body.standing_off import patches_of

CLOTHING_MEAN_M: Final = 0.006  # m, mean thickness of clothes
CLOTHING_SIGMA_M: Final = 0.003  # m, standard deviation of the thickness of clothes
# m, standard deviation of the offset of a patch of skin, due to muscles, fat and folds that no coefficient describes.
# In real recordings, the learnt offsets of patches of skin were larger than this. The values 3.5, 7 and 12 mm were
# compared: with 7 mm, joints were nearest to the truth (suite ``easy`` of ``benchmarks/run.py``, seeds for tuning), and
# nearer to the labels of the data set MSR Action3D than with 3.5 mm.
PATCH_SIGMA_M: Final = 0.007
THICKEST_M: Final = 0.03  # m, maximum thickness of clothes
# degrees of freedom of Student's t distribution, the prior of all parameters except the whole-body coefficients: 1 in
# 20 of these parameters deviates by over 2.8 sigma
TAILS: Final = 4.0
# factor on the standard deviation of a segment's thickness if an orthosis or a helmet covers the segment
COVERED: Final = 4.0
# number of fits of the shape to a measured height; the fit is repeated, since a fit may make another vertex of the skin
# the highest or lowest
_HEIGHT_STEPS: Final = 3

_ALIKE_LENGTHS: Final = np.array(
    [[1.00, 0.34, 0.18, 0.35], [0.34, 1.00, 0.25, 0.43], [0.18, 0.25, 1.00, 0.04], [0.35, 0.43, 0.04, 1.00]]
)
"""Correlations between the lengths of ``LENGTH_SIGMA`` among people of one height and sex, also from ANSUR II."""

_ALIKE_GIRTHS: Final = np.array(
    [[1.0, 0.6, 0.0, 0.0], [0.6, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.6], [0.0, 0.0, 0.6, 1.0]]
)
"""Correlations between the girths of ``GIRTH_SIGMA``: for the arm as in ANSUR II; for the leg equally high, since
paralysis wastes a leg as a whole."""

_ALIKE_SIDES: Final = {"length": 0.90, "girth": 0.80, "size": 0.95}
"""Correlations between a left segment and the right one. With these values, the median difference between left and
right lengths is 2 % among the most asymmetric 5 % of people. (Legs differ by 5 mm on average, by 20 mm in one person in
a thousand, and by more with contractures: Knutson 2005, doi:10.1186/1746-1340-13-11.)"""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeBelief:
    """The most likely shape, given a prior and observations.

    The s free parameters are the first coefficients of the shape and its first offsets (of clothes, then of patches of
    skin); ``free`` states how many of each are free. All other parameters are fixed.
    """

    shape: FittedShape
    free: FreeShape
    mean: np.ndarray  # (s,) mean of the prior
    prior: np.ndarray  # (s, s) information (inverse covariance) of the prior
    # (s,) bool, parameters with Student's t as prior: a very unusual value is only a little less probable than an
    # unusual value
    soft: np.ndarray
    seen: np.ndarray  # (s, s) information (inverse covariance) that the observations alone give
    pull: np.ndarray  # (s,) matrix ``seen`` times the shape that fits the observations best

    @property
    def information(self) -> np.ndarray:
        """Return the inverse covariance (s, s) of the free parameters, at the most likely shape."""
        return self._prior_at(self.shape) + self.seen

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance (s, s) of the free parameters, at the most likely shape."""
        return _covariance(self)

    def equations(self, shape: FittedShape) -> tuple[np.ndarray, np.ndarray]:
        """Return hessian (s, s) and gradient (s,) of the cost of a shape, which is half the sum of its squared
        deviations from prior and observations.
        """
        prior, at = self._prior_at(shape), self.vector(shape)
        return prior + self.seen, prior @ (at - self.mean) + self.seen @ at - self.pull

    def _prior_at(self, shape: FittedShape) -> np.ndarray:
        """Return the prior's inverse covariance (s, s) at a shape; this matrix is reduced for ``soft`` parameters with
        unusual values (Lange et al. 1989, doi:10.2307/2290063).
        """
        away2 = (self.vector(shape) - self.mean) ** 2 / np.diag(np.linalg.inv(self.prior))
        weight = np.where(self.soft, np.sqrt((TAILS + 1.0) / (TAILS + away2)), 1.0)
        return self.prior * np.outer(weight, weight)

    def vector(self, shape: FittedShape) -> np.ndarray:
        """Return the free parameters (s,) of a shape: coefficients, then offsets."""
        return np.append(shape.coefficients[: self.free.coefficients], shape.offset_m[: self.free.offsets])

    def moved(self, shape: FittedShape, change: np.ndarray) -> FittedShape:
        """Return a shape after a change (s,); the thickness of clothes stays between zero and ``THICKEST_M``."""
        coefficients, offset_m = shape.coefficients.copy(), shape.offset_m.copy()
        coefficients[: self.free.coefficients] += change[: self.free.coefficients]
        offset_m[: self.free.offsets] += change[self.free.coefficients :]
        offset_m[: len(CLOTHES)] = np.clip(offset_m[: len(CLOTHES)], 0.0, THICKEST_M)
        return replace(shape, coefficients=coefficients, offset_m=offset_m)

    def having_seen(self, shape: FittedShape, information: np.ndarray, pull: np.ndarray) -> ShapeBelief:
        """Return the belief after more observations. information (s, s): inverse covariance that the new observations
        alone give. pull (s,): this matrix times the shape that fits the new observations best.
        """
        return replace(self, shape=shape, seen=self.seen + information, pull=self.pull + pull)

    def including(self, others: Sequence[FittedShape], shares: np.ndarray) -> ShapeBelief:
        """Return the belief with the same shape and a covariance enlarged to include other possible shapes. shares
        (n,): the probability of each other shape. The enlarged covariance may exceed the covariance of the prior; then
        ``seen`` is not a valid information matrix, so this belief must not be refined with more frames.
        """
        at, prior = self.vector(self.shape), self._prior_at(self.shape)
        away = np.array([self.vector(other) for other in others]) - at
        seen = np.linalg.inv(self.covariance + (away.T * shares) @ away) - prior
        return replace(self, seen=seen, pull=seen @ at + prior @ (at - self.mean))

    def cost(self, shape: FittedShape) -> float:
        """Return the sum of a shape's squared deviations from the prior's mean, in standard deviations."""
        away = self.vector(shape) - self.mean
        return float(away @ self._prior_at(shape) @ away)

    def deviations(self, shape: FittedShape) -> np.ndarray:
        """Return (s,) the deviation of each parameter from its mean, in standard deviations of the prior."""
        return np.abs(self.vector(shape) - self.mean) / np.sqrt(np.diag(np.linalg.inv(self.prior)))

    def variance(self, rows: np.ndarray) -> np.ndarray:
        """Return the variances (m,) of m quantities that depend on the shape. rows (m, n): derivatives of these
        quantities by the n free coefficients.
        """
        count = self.free.coefficients
        covariance = self.covariance[:count, :count]
        return np.asarray(((rows @ covariance) * rows).sum(axis=1))

    def lacking(self, parts: tuple[str, ...]) -> ShapeBelief:
        """Return the belief for a body that lacks some parts, such as ``shank_left``."""
        return replace(self, shape=replace(self.shape, missing=parts))

    def covering(self, asset: BodyAsset, parts: Sequence[str]) -> ShapeBelief:
        """Return the belief with some segments covered by orthoses or other things of unknown thickness."""
        wider = np.ones(len(self.mean))
        for part in parts:
            wider[[asset.own_row(name) for name in _directions_of(part)]] = COVERED
            wider[self.free.coefficients + len(CLOTHES) + patches_of(skin_points(asset), part)] = COVERED
        shoes = [part for part in parts if part.startswith("foot")]
        wider[self.free.coefficients + list(CLOTHES).index("shoes")] = COVERED if shoes else 1.0
        return replace(self, prior=self.prior / np.outer(wider, wider))

    def common(self, asset: BodyAsset) -> ShapeBelief:
        """Return this belief as a prior in which only whole-body coefficients and clothes are free; all other
        parameters are fixed.
        """
        free = FreeShape(asset.common_count, len(CLOTHES))
        kept = np.r_[: free.coefficients, self.free.coefficients : self.free.coefficients + free.offsets]
        information = np.linalg.inv(self.covariance[np.ix_(kept, kept)])
        return _only_prior(self.shape, free, self.vector(self.shape)[kept], information)

    def standing(self, asset: BodyAsset, height_m: float, sigma_m: float) -> ShapeBelief:
        """Return the belief after a measurement of the standing height, linearised at the shape with that height."""
        belief = self
        for _ in range(_HEIGHT_STEPS):
            shape = belief.shape
            own_m, row = standing_height(asset, shape)
            row = np.append(row[: self.free.coefficients], np.zeros(self.free.offsets)) / sigma_m
            target = (height_m - own_m) / sigma_m + row @ self.vector(shape)
            belief = self.having_seen(shape, np.outer(row, row), row * target)
            hessian, gradient = belief.equations(shape)
            belief = replace(belief, shape=self.moved(shape, -np.linalg.solve(hessian, gradient)))
        return belief


@lru_cache(maxsize=2)  # cached, since every frame needs the covariance
def _covariance(belief: ShapeBelief) -> np.ndarray:
    return np.linalg.inv(belief.information)


def _directions_of(part: str) -> tuple[str, ...]:
    """Return the names of the shape coefficients that make a segment, covered for example by an orthosis, thicker or
    larger.
    """
    if part == "head":
        return ("head_size",)
    if part == "trunk":
        return ("belly_depth", "waist_breadth", "chest_depth", "back_depth", "chest_breadth")
    name, side = part.rsplit("_", 1)
    return (f"{name}_size_{side}",) if name in ("hand", "foot") else (f"{name}_girth_{side}",)


def _only_prior(shape: FittedShape, free: FreeShape, mean: np.ndarray, information: np.ndarray) -> ShapeBelief:
    nothing = np.zeros_like(information)
    return ShapeBelief(shape, free, mean, information, np.zeros(len(mean), bool), nothing, nothing[0])


def adult_belief(asset: BodyAsset) -> ShapeBelief:
    """Return the prior belief in an adult's shape."""
    return _belief(asset, np.zeros(asset.common_count), np.diag(asset.adult_sigma**2))


def child_belief(asset: BodyAsset) -> ShapeBelief:
    """Return the prior belief in the shape of a child 0.95 to 1.60 m tall."""
    return _belief(asset, asset.child_mean, asset.child_covariance)


def _belief(asset: BodyAsset, common: np.ndarray, covariance: np.ndarray) -> ShapeBelief:
    """Return the prior belief in the shape of a person from a group (adults or children). common (c,), covariance (c,
    c): mean and covariance of the group's whole-body coefficients. Coefficients of single segments have mean 0 and
    standard deviation 1.
    """
    coefficients = np.append(common, np.zeros(len(asset.own_names)))
    mean = FittedShape(coefficients, even_clothes(CLOTHING_MEAN_M))
    free = FreeShape(asset.shape_count, OFFSETS)
    offset_sigma_m = np.r_[np.full(len(CLOTHES), CLOTHING_SIGMA_M), np.full(PATCHES, PATCH_SIGMA_M)]
    information = block_diag(
        np.linalg.inv(covariance), np.linalg.inv(_correlations(asset)), np.diag(1.0 / offset_sigma_m**2)
    )
    belief = _only_prior(mean, free, np.append(mean.coefficients, mean.offset_m), information)
    return replace(belief, soft=np.arange(len(information)) >= asset.common_count)


def _correlations(asset: BodyAsset) -> np.ndarray:
    """Return the correlations (k, k) of the coefficients of single segments."""
    found = np.eye(len(asset.own_names))
    sizes = tuple(name for name in END_SIGMA if name != "head")
    for kind, segments, alike in (
        ("length", tuple(LENGTH_SIGMA), _ALIKE_LENGTHS),
        ("girth", tuple(GIRTH_SIGMA), _ALIKE_GIRTHS),
        ("size", sizes, np.eye(len(sizes))),
    ):
        names = [f"{segment}_{kind}_{side}" for side in SIDES for segment in segments]
        rows = [asset.own_names.index(name) for name in names]
        sides = np.array([[1.0, _ALIKE_SIDES[kind]], [_ALIKE_SIDES[kind], 1.0]])
        found[np.ix_(rows, rows)] = np.kron(sides, alike)
    return found


def standing_height(asset: BodyAsset, shape: FittedShape) -> tuple[float, np.ndarray]:
    """Return the height in metres of the body at rest, without clothes, and its derivative (k,) by the coefficients.

    Missing parts count as present: a stated height is the height with a prosthesis or before the loss of the part.
    """
    vertices = shape_body(asset, shape.coefficients).vertices
    up, left = vertices[:, 1], vertices[:, 2] < 0.0
    top, count = up.argmax(), len(shape.coefficients)
    # people are measured while standing on both feet, so the height is measured from midway between both soles
    soles = [int(np.where(side, up, np.inf).argmin()) for side in (left, ~left)]
    row = asset.vertex_basis[:count, top, 1] - asset.vertex_basis[:count, soles, 1].mean(axis=1)
    return float(up[top] - up[soles].mean()), row


def shape_of_height(asset: BodyAsset, height_m: float) -> FittedShape:
    """Return the shape of the mean adult in clothes of mean thickness, scaled to a height by the coefficient that
    changes the height.
    """
    coefficients = np.zeros(asset.shape_count)
    per_unit = np.ptp(asset.vertices[:, 1] + asset.vertex_basis[0, :, 1]) - np.ptp(asset.vertices[:, 1])
    coefficients[0] = np.clip((height_m - np.ptp(asset.vertices[:, 1])) / per_unit, -2.5, 2.5)
    return FittedShape(coefficients, even_clothes(CLOTHING_MEAN_M))
