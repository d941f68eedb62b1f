"""Draw one simulated person: a body that is not exactly in the tracker's shape space (the body shapes that its model
can represent), in clothes with folds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numba as nb
import numpy as np

from anchorpose.body.asset import ADULT_COMPONENTS, BodyAsset, stored_asset
from anchorpose.body.kinematics import BodyMesh, shape_body
from anchorpose.rotations import unit
from anchorpose.simulate.bodies import (
    BELLY_M,
    BRACE_M,
    BRACED,
    SHOD_SHARE,
    SHOE_M,
    SOLE_M,
    OtherBody,
    amputated,
    draw_scales,
    rescale,
    to_height,
    with_belly,
    with_brace,
    with_shoes,
)
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.rigged_body import read_rigged_body

SHORTEST_M, TALLEST_M = 1.5, 1.9
# standard deviation of each drawn shape coefficient, divided by its standard deviation in the shape space
COEFFICIENT_SPREAD = 0.8
BUMPS = 14  # number of bumps on the skin of a body
FOLDS = 7  # number of waves whose sum gives the folds of clothes
# mean and standard deviation of clothes' height, in units of ``Clothes.amplitude_m``
MEAN_HEIGHT, FOLD_HEIGHT = 0.75, 0.32
# GAP_SPREAD: standard deviation of the logarithm of the gap between skin and clothes. GAP_PER_FOLD: wavelength of the
# gap's variation over the skin, divided by the wavelength of the folds. These gaps make simulated clothes similar to
# real ones. For each patch of skin, tracking learns the offset of the seen surface from the bare skin (with a prior of
# 20 mm). The root mean square of these offsets was 5 mm in a simulated recording without such gaps, 14 mm in two
# simulated recordings with gaps, and 17 mm in twelve real recordings, which include coarser sensors and other bodies.
GAP_SPREAD, GAP_PER_FOLD = 1.0, 4.0
CHILD_HEIGHTS_M = (1.0, 1.5)
CHILD_SPREAD = 0.9  # factor on the standard deviations of the asset's distribution of children
LOOSE_SHIRT, LOOSE_TROUSERS = (0.4, 1.2), (0.5, 2.0)  # ranges of a factor on the height of folds
# a bone is bare if its name contains one of these texts
BARE = ("Head", "Neck1", "Hand", "Thumb", "Finger", "Foot", "Toe")


@dataclass(frozen=True, slots=True, eq=False)
class Clothes:
    """Folds of clothes: a sum of waves over the skin at rest, with phases that change with time and with the pose."""

    cover: np.ndarray  # (v,) factor on the height of the clothes above each vertex; 0 = bare
    # (v,) factor on the clothes' mean distance from the skin; where it is below 1, it also lowers the folds
    gap: np.ndarray
    waves: np.ndarray  # (k, 3) rad/m, wave vectors
    phase: np.ndarray  # (k,) rad, phase of each wave at time 0 in the rest pose
    drift: np.ndarray  # (k,) rad/s, change of phase with time
    bend_gain: np.ndarray  # (k,) change of phase, in rad, for each rad by which joints are bent
    amplitude_m: float  # height of a fold


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """A body of a given shape, its clothes, and the normals along which clothes lie above the skin."""

    body: BodyMesh
    coefficients: np.ndarray  # (k,) shape coefficients; empty for a body from a file
    height_m: float
    clothes: Clothes
    normals: np.ndarray  # (v, 3) outward normals of the skin in the rest pose

    def skin(self, transforms: np.ndarray, time_s: float) -> np.ndarray:
        """Return the dressed skin (v, 3), float32 world metres; transforms (b, 4, 4): T_world_rest of the bones."""
        asset, clothes = self.body.asset, self.clothes
        rest = _RestSkin(
            self.body.vertices.astype(np.float32),
            self.normals.astype(np.float32),
            asset.skin_bones.astype(np.int32),
            asset.skin_weights.astype(np.float32),
        )
        folds = _Folds(
            clothes.cover.astype(np.float32),
            clothes.gap.astype(np.float32),
            clothes.waves.astype(np.float32),
            (clothes.phase + clothes.drift * time_s).astype(np.float32),
            clothes.bend_gain.astype(np.float32),
            clothes.amplitude_m,
        )
        skin = np.empty((len(self.normals), 3), dtype=np.float32)
        motions, bend = transforms[:, :3, :].astype(np.float32), bends(asset, transforms).astype(np.float32)
        _dress_and_skin(rest, folds, motions, bend, skin)
        return skin


def draw_person(rng: np.random.Generator, clothing_m: float, height_m: float | None = None) -> Person:
    """Return a random adult with all shape coefficients drawn. height_m: None = drawn."""
    asset = stored_asset()
    height_m = float(rng.uniform(SHORTEST_M, TALLEST_M)) if height_m is None else height_m
    coefficients = np.zeros(asset.shape_count)
    coefficients[:ADULT_COMPONENTS] = rng.normal(0.0, COEFFICIENT_SPREAD, ADULT_COMPONENTS).clip(-1.8, 1.8)
    coefficients[0] = 0.0
    coefficients[0] = (height_m - _stature_m(asset, coefficients)) / _stature_gain_m(asset)
    plain = shape_body(asset, coefficients)
    normals = vertex_normals(plain.vertices, asset.faces)
    bumpy = plain.vertices + normals * _bumps_m(rng, asset, plain.vertices)[:, None]
    drop = np.array([0.0, bumpy[:, 1].min(), 0.0])
    body = BodyMesh(asset, bumpy - drop, plain.bone_heads - drop, plain.bone_tails - drop)
    return Person(body, coefficients, height_m, _draw_clothes(rng, asset, clothing_m), normals)


def draw_child(rng: np.random.Generator, clothing_m: float, height_m: float | None = None) -> Person:
    """Draw a child from the body asset's distribution of children, with less spread. height_m: None = drawn."""
    asset = stored_asset()
    height_m = float(rng.uniform(*CHILD_HEIGHTS_M)) if height_m is None else height_m
    drawn = rng.multivariate_normal(asset.child_mean, CHILD_SPREAD**2 * asset.child_covariance, 200)
    heights_m = np.array([_stature_m(asset, coefficients) for coefficients in drawn])
    coefficients = drawn[np.abs(heights_m - height_m).argmin()]
    plain = to_height(shape_body(asset, coefficients), height_m)
    normals = vertex_normals(plain.vertices, asset.faces)
    return Person(plain, coefficients, height_m, _draw_clothes(rng, asset, clothing_m), normals)


def draw_patient_person(rng: np.random.Generator, config: SimulationConfig) -> Person:
    """Draw the patient of a recording, with the body that ``config`` describes."""
    if config.body == OtherBody():
        return draw_person(rng, config.clothing_m, config.height_m)
    return draw_other_person(rng, config.body, config.clothing_m, config.height_m)


def draw_other_person(
    rng: np.random.Generator, config: OtherBody, clothing_m: float, height_m: float | None = None
) -> Person:
    """Draw a person whose body is not in the asset's shape space. Trousers and shirt differ in how loose they are."""
    plain = _draw_plain(rng, config, clothing_m, height_m)
    body = plain.body
    if config.file is None:
        body = to_height(rescale(body, draw_scales(rng, body.asset.bone_names, config.build)), plain.height_m)
    normals, asset = vertex_normals(body.vertices, body.asset.faces), body.asset
    if config.build == "heavy":
        body = with_belly(body, normals, rng.uniform(*BELLY_M))
    braced = np.zeros(len(normals))
    for name in config.braces:
        body, covered = with_brace(body, BRACED[name], rng.uniform(*BRACE_M))
        braced = np.maximum(braced, covered)
    shod = config.build != "ordinary" and rng.random() < SHOD_SHARE
    upper_m, sole_m = rng.uniform(*SHOE_M), rng.uniform(*SOLE_M)
    if shod:
        body = with_shoes(body, normals, upper_m, sole_m)
    drop = np.array([0.0, body.vertices[:, 1].min(), 0.0])
    body = BodyMesh(asset, body.vertices - drop, body.bone_heads - drop, body.bone_tails - drop)
    cover = plain.clothes.cover * (1.0 - braced) * _looseness(rng, asset)
    dressed = replace(plain.clothes, cover=cover)
    if config.missing:
        body = amputated(body, config.missing)
    return Person(body, plain.coefficients, plain.height_m, dressed, vertex_normals(body.vertices, asset.faces))


def _draw_plain(rng: np.random.Generator, config: OtherBody, clothing_m: float, height_m: float | None) -> Person:
    """Draw a person before the changes that ``draw_other_person`` makes: scaled segments, belly, braces and shoes."""
    if config.file is not None:
        body = read_rigged_body(config.file)
        body = body if height_m is None else to_height(body, height_m)
        normals = vertex_normals(body.vertices, body.asset.faces)
        clothes = _draw_clothes(rng, body.asset, clothing_m)
        return Person(body, np.zeros(0), float(np.ptp(body.vertices[:, 1])), clothes, normals)
    if config.build == "child":
        return draw_child(rng, clothing_m, height_m)
    return draw_person(rng, clothing_m, height_m)


def _looseness(rng: np.random.Generator, asset: BodyAsset) -> np.ndarray:
    """Return factors (v,) on the height of folds, drawn separately for shirt and trousers."""
    shirt, trousers = rng.uniform(*LOOSE_SHIRT), rng.uniform(*LOOSE_TROUSERS)
    legs = np.array([name.endswith(("UpLeg", "Leg")) for name in asset.bone_names])
    share = (asset.skin_weights * legs[asset.skin_bones]).sum(axis=1)
    return np.asarray(shirt + share * (trousers - shirt))


def skin_points(person: Person, bones: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and normals of the dressed skin, (t, n, 3) each, at ``vertices`` (n,); the clothes have their mean
    height above the skin.
    """
    asset, clothes = person.body.asset, person.clothes
    normals = person.normals[vertices]
    height_m = MEAN_HEIGHT * clothes.amplitude_m * clothes.cover[vertices] * clothes.gap[vertices]
    rest = person.body.vertices[vertices] + height_m[:, None] * normals
    moved = bones[:, asset.skin_bones[vertices]]
    weights = asset.skin_weights[vertices]
    place = np.einsum("nw,tnwij,nj->tni", weights, moved[..., :3, :3], rest)
    place += np.einsum("nw,tnwi->tni", weights, moved[..., :3, 3])
    return place, unit(np.einsum("nw,tnwij,nj->tni", weights, moved[..., :3, :3], normals))


def bends(asset: BodyAsset, transforms: np.ndarray) -> np.ndarray:
    """Return (b,) rad: the angle by which each bone is turned relative to its parent, compared with the rest pose."""
    turns = transforms[:, :3, :3]
    parents = np.maximum(asset.bone_parents, 0)
    cosine = (np.einsum("bij,bij->b", turns[parents], turns) - 1.0) / 2.0
    return np.where(asset.bone_parents >= 0, np.arccos(np.clip(cosine, -1.0, 1.0)), 0.0)


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return (v, 3) area-weighted unit normals."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], areas)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _stature_m(asset: BodyAsset, coefficients: np.ndarray) -> float:
    return float(np.ptp(shape_body(asset, coefficients).vertices[:, 1]))


def _stature_gain_m(asset: BodyAsset) -> float:
    """Return the height in metres that one unit of the first shape coefficient adds to a body."""
    step = np.zeros(asset.shape_count)
    step[0] = 1.0
    return _stature_m(asset, step) - _stature_m(asset, 0.0 * step)


def _dressed(asset: BodyAsset) -> np.ndarray:
    """Return (v,): 1 under clothes, 0 on hands, head and feet, values between at the hems."""
    wears = np.array([not any(bare in name for bare in BARE) for name in asset.bone_names], dtype=np.float64)
    return (asset.skin_weights * wears[asset.skin_bones]).sum(axis=1)


def _bumps_m(rng: np.random.Generator, asset: BodyAsset, vertices: np.ndarray) -> np.ndarray:
    """Return random bumps of the skin, (v,) metres outward, as muscle, fat and spasms cause them. The bumps differ
    between the left and the right side.
    """
    dressed = _dressed(asset)
    centres = vertices[rng.choice(np.flatnonzero(dressed > 0.9), BUMPS)]
    height_m = rng.normal(0.0, 0.005, BUMPS).clip(-0.008, 0.008)
    radius_m = rng.uniform(0.05, 0.11, BUMPS)
    distance2 = ((vertices[:, None] - centres) ** 2).sum(axis=2)
    return dressed * (height_m * np.exp(-0.5 * distance2 / radius_m**2)).sum(axis=1)


def _draw_clothes(rng: np.random.Generator, asset: BodyAsset, amplitude_m: float) -> Clothes:
    """Draw folds, 6 to 25 cm from crest to crest. More folds run across the limbs than along them."""
    direction = rng.normal(size=(FOLDS, 3)) * [0.7, 1.0, 0.7]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    wavelength_m = rng.uniform(0.06, 0.25, FOLDS)
    waves, phase = direction * (2.0 * np.pi / wavelength_m)[:, None], rng.uniform(0.0, 2.0 * np.pi, FOLDS)
    return Clothes(
        cover=_dressed(asset),
        gap=np.exp(GAP_SPREAD * _smooth(asset.vertices, waves / GAP_PER_FOLD, 2.0 * phase)),
        waves=waves,
        phase=phase,
        drift=rng.normal(0.0, 0.6, FOLDS),
        bend_gain=rng.normal(0.0, 2.0, FOLDS),
        amplitude_m=amplitude_m,
    )


def _smooth(vertices: np.ndarray, waves: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """Return (v,) a sum of waves over the skin at rest, with variance 1 and clipped to two standard deviations."""
    return np.clip(np.sqrt(2.0 / len(phase)) * np.sin(vertices @ waves.T + phase).sum(axis=1), -2.0, 2.0)


class _RestSkin(NamedTuple):
    """The skin at rest."""

    vertices: np.ndarray  # (v, 3) float32, positions of the vertices
    normals: np.ndarray  # (v, 3) float32, outward normals at the vertices
    bones: np.ndarray  # (v, w) int32, bones that move each vertex
    weights: np.ndarray  # (v, w) float32, weights of these bones


class _Folds(NamedTuple):
    """The folds of ``Clothes`` at one moment, as float32 arrays."""

    cover: np.ndarray
    gap: np.ndarray
    waves: np.ndarray
    phase: np.ndarray
    bend_gain: np.ndarray
    amplitude_m: float


@nb.njit(cache=True)
def _dress_and_skin(rest: _RestSkin, folds: _Folds, transforms: np.ndarray, bend: np.ndarray, skin: np.ndarray) -> None:
    """Fill ``skin`` (v, 3) with the dressed skin moved by transforms (b, 3, 4); bend (b,): the result of ``bends``."""
    blend = np.empty((3, 4), dtype=np.float32)
    for v in range(len(rest.vertices)):
        blend[:] = 0.0
        bent = np.float32(0.0)
        for k in range(rest.bones.shape[1]):
            weight = rest.weights[v, k]
            if weight == 0.0:
                continue
            bone = rest.bones[v, k]
            bent += weight * bend[bone]
            for i in range(3):
                for j in range(4):
                    blend[i, j] += weight * transforms[bone, i, j]
        off = _height_m(folds, rest.vertices[v], folds.cover[v], folds.gap[v], bent)
        x = rest.vertices[v, 0] + off * rest.normals[v, 0]
        y = rest.vertices[v, 1] + off * rest.normals[v, 1]
        z = rest.vertices[v, 2] + off * rest.normals[v, 2]
        for i in range(3):
            skin[v, i] = blend[i, 0] * x + blend[i, 1] * y + blend[i, 2] * z + blend[i, 3]


@nb.njit(cache=True)
def _height_m(folds: _Folds, place: np.ndarray, cover: np.float32, gap: np.float32, bent: np.float32) -> float:
    """Return the height of the clothes above one place of the skin at rest, metres."""
    if not (cover > 0.0 and folds.amplitude_m > 0.0):
        return 0.0
    wave = np.float32(0.0)
    for k in range(len(folds.phase)):
        argument = folds.waves[k, 0] * place[0] + folds.waves[k, 1] * place[1] + folds.waves[k, 2] * place[2]
        wave += np.sin(argument + folds.phase[k] + folds.bend_gain[k] * bent)
    scale = np.float32(np.sqrt(2.0 / len(folds.phase)))
    # tight clothes have lower folds, so that nearly all cloth lies above the skin
    fold = np.float32(FOLD_HEIGHT) * min(gap, np.float32(1.0)) * scale * wave
    return float(folds.amplitude_m * cover * (np.float32(MEAN_HEIGHT) * gap + fold))
