"""People for the training images: bodies of any shape in any posture, many at once, on any device."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import torch

from anchorpose.body.asset import BodyAsset, stored_asset
from anchorpose.body.joint_ranges import hinge_axes

SIDES: Final = (("Left", -1.0), ("Right", 1.0))
POSTURES: Final = ("stands", "sits", "squats", "lunges", "bends", "lies", "anyhow", "kneels")
POSTURE_SHARES: Final = (0.33, 0.18, 0.10, 0.08, 0.07, 0.10, 0.07, 0.07)
CHILDREN: Final = 0.15  # of all people
MISSING: Final = 0.03  # people without a part of a limb
STUMPS: Final = ("LeftForeArm", "RightForeArm", "LeftHand", "RightHand", "LeftLeg", "RightLeg", "LeftFoot", "RightFoot")
PATCHES: Final = 64
GARMENTS: Final = {
    "trunk": ("LowerBack", "Spine", "Shoulder"),
    "arms": ("LeftArm", "RightArm"),
    "forearms": ("ForeArm",),
    "thighs": ("Hips", "HipJoint", "UpLeg"),
    "shanks": ("LeftLeg", "RightLeg"),
    "feet": ("Foot", "ToeBase"),
    "head": ("Head", "Neck"),
}
"""Bones whose skin each part of the clothes covers."""
PLACE_SPREAD: Final = 12.0  # waves of cloth: radians a metre at most


class Build(NamedTuple):
    """n bodies: child (n,) bool, shape (n, k) coefficients of the asset, size (n,) factor of the shaped body, cloth_m
    (n,) mean distance from cloth to skin."""

    child: torch.Tensor
    shape: torch.Tensor
    size: torch.Tensor
    cloth_m: torch.Tensor


class Posed(NamedTuple):
    """n people: skin (n, v, 3) m with the feet at height 0, pelvis (n, 3), posture (n,) index, facing (n,) radians; the
    rest as in ``Build``."""

    skin_m: torch.Tensor
    pelvis_m: torch.Tensor
    posture: torch.Tensor
    facing: torch.Tensor
    child: torch.Tensor
    shape: torch.Tensor
    size: torch.Tensor
    cloth_m: torch.Tensor


@dataclass(frozen=True)
class Surface:
    """The body's surface as the descriptor names it: places (f, 3) of each face on the mean adult of stature 1, X
    forward, Y up from the floor, Z right; patch (f,) of each face; centres (p, 3) of the patches."""

    places: np.ndarray
    patch: np.ndarray
    centres: np.ndarray


def surface_of(asset: BodyAsset) -> Surface:
    """Patches around points that are spread evenly over the skin, along the mesh: no patch joins arm and trunk."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    skin = asset.vertices
    stature = np.ptp(skin[:, 1])
    edges = np.concatenate([asset.faces[:, [0, 1]], asset.faces[:, [1, 2]], asset.faces[:, [2, 0]]])
    lengths = np.linalg.norm(skin[edges[:, 0]] - skin[edges[:, 1]], axis=1)
    graph = coo_matrix((lengths, edges.T), shape=(len(skin),) * 2).tocsr()
    parts = asset.main_bone()
    hands = np.isin(parts, [i for i, name in enumerate(asset.bone_names) if "Hand" in name or "Finger" in name])
    nearest = np.full(len(skin), np.inf)
    owner = np.zeros(len(skin), dtype=np.int64)
    seeds = [int(skin[:, 1].argmax())]
    while True:
        distance = dijkstra(graph, indices=seeds[-1], directed=False)
        closer = distance < nearest
        owner[closer], nearest[closer] = len(seeds) - 1, distance[closer]
        if len(seeds) == PATCHES:
            break
        seeds.append(int(np.where(hands, 1.5, 1.0)[np.arange(len(skin))].__mul__(nearest).argmax()))
    base = np.array([0.0, skin[:, 1].min(), 0.0])
    places = (skin[asset.faces].mean(axis=1) - base) / stature
    patch = owner[asset.faces[:, 0]]
    centres = np.stack([places[patch == p].mean(axis=0) for p in range(PATCHES)])
    return Surface(places.astype(np.float32), patch, centres.astype(np.float32))


class People:
    """Draws bodies and postures; every draw is from ``generator``."""

    def __init__(self, device: torch.device, generator: torch.Generator) -> None:
        asset = stored_asset()
        self.asset, self.device, self.generator = asset, device, generator
        weights = np.zeros((len(asset.vertices), len(asset.bone_names)))
        np.add.at(weights, (np.arange(len(weights))[:, None], asset.skin_bones), asset.skin_weights)
        self.weights = self._tensor(weights)
        self.vertices, self.basis = self._tensor(asset.vertices), self._tensor(asset.vertex_basis)
        self.heads, self.head_basis = self._tensor(asset.bone_heads), self._tensor(asset.bone_head_basis)
        self.faces = torch.as_tensor(asset.faces.astype(np.int64), device=device)
        self.normals = self._tensor(_normals(asset))
        self.parents = asset.bone_parents.tolist()
        self.sigma = self._tensor(asset.adult_sigma)
        self.child_mean = self._tensor(asset.child_mean)
        spread, turned = np.linalg.eigh(asset.child_covariance)
        self.child_root = self._tensor(turned * np.sqrt(np.clip(spread, 0.0, None)))
        self.share = {name: self._share(parts) for name, parts in GARMENTS.items()}
        self.main_bone = torch.as_tensor(asset.main_bone(), device=device)

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(np.asarray(values, dtype=np.float32), device=self.device)

    def _share(self, parts: tuple[str, ...]) -> torch.Tensor:
        """(v,) how far the skin hangs on bones whose names hold one of ``parts``."""
        mine = [i for i, bone in enumerate(self.asset.bone_names) if any(part in bone for part in parts)]
        return self.weights[:, mine].sum(dim=1)

    def uniform(self, *shape: int, low: float = 0.0, high: float = 1.0) -> torch.Tensor:
        """Uniform numbers."""
        return torch.rand(*shape, device=self.device, generator=self.generator) * (high - low) + low

    def normal(self, *shape: int, sigma: float = 1.0) -> torch.Tensor:
        """Normal numbers of mean 0."""
        return torch.randn(*shape, device=self.device, generator=self.generator) * sigma

    def draw(self, count: int) -> Posed:
        """``count`` people, each upon the floor at the origin."""
        skin, heads, build = self._dressed(count)
        posture = torch.multinomial(
            torch.tensor(POSTURE_SHARES, device=self.device), count, replacement=True, generator=self.generator
        )
        facing = self.uniform(count, low=-math.pi, high=math.pi)
        turns = self._turns(posture, facing)
        transforms = self._forward(turns, heads)
        blended = torch.einsum("vb,nbk->nvk", self.weights, transforms[:, :, :3].reshape(count, len(self.parents), 12))
        blended = blended.reshape(count, -1, 3, 4)
        posed = torch.einsum("nvij,nvj->nvi", blended[..., :3], skin) + blended[..., 3]
        pelvis = transforms[:, 0, :3, 3] + torch.einsum("nij,nj->ni", transforms[:, 0, :3, :3], heads[:, 0])
        low = posed[:, :, 1].amin(dim=1)
        shift = torch.stack([-pelvis[:, 0], -low, -pelvis[:, 2]], dim=1)
        return Posed(posed + shift[:, None], pelvis + shift, posture, facing, *build)

    def _dressed(self, count: int) -> tuple[torch.Tensor, torch.Tensor, Build]:
        """Rest skins in clothes, the heads of the bones, and what was drawn."""
        child = self.uniform(count) < CHILDREN
        adult = self.normal(count, len(self.sigma)) * self.sigma * 1.2
        small = self.child_mean + self.normal(count, len(self.sigma)) @ self.child_root.T
        shape = torch.where(child[:, None], small, adult)
        used = shape.shape[1]
        skin = self.vertices + torch.einsum("nk,kvi->nvi", shape, self.basis[:used])
        heads = self.heads + torch.einsum("nk,kbi->nbi", shape, self.head_basis[:used])
        out, cloth_m = self._clothes(count)
        skin = skin + out
        size = self.uniform(count, low=0.93, high=1.07)[:, None, None]
        skin, heads = skin * size, heads * size
        for name in STUMPS:
            lost = self.uniform(count) < MISSING / len(STUMPS)
            if bool(lost.any()):
                below = torch.isin(self.main_bone, torch.tensor(self._below(name), device=self.device))
                stump = heads[:, self.asset.bone(name), None]
                skin = torch.where((lost[:, None] & below)[:, :, None], stump, skin)
        return skin, heads, Build(child, shape, size[:, 0, 0], cloth_m)

    def _below(self, name: str) -> list[int]:
        found = [self.asset.bone(name)]
        for bone, parent in enumerate(self.parents):
            if parent in found:
                found.append(bone)
        return found

    def _clothes(self, count: int) -> tuple[torch.Tensor, torch.Tensor]:
        """How far cloth, hair and shoes stand off the skin (n, v, 3); (n,) the mean of shirt and trousers."""
        skin, normals, share = self.vertices, self.normals, self.share
        height = skin[:, 1]
        shirt, trousers = self.uniform(count, 1) ** 2 * 0.045, self.uniform(count, 1) ** 2 * 0.035
        hem, chest = self.uniform(count, 1, low=0.70, high=1.0), share["trunk"].amax()  # m above the floor
        hangs = 0.6 + 0.8 * ((1.35 - height) / (1.35 - hem)).clamp(0.0, 1.0)
        worn = ((share["trunk"] + share["thighs"]) * (height > hem)).clamp_max(chest) * hangs
        sleeves = self.uniform(count, 1)
        worn = worn + 0.7 * (share["arms"] * (sleeves > 0.15) + share["forearms"] * (sleeves > 0.6))
        flare = self.uniform(count, 1) ** 2 * 0.03 * ((0.5 - height) / 0.4).clamp(0.0, 1.0)
        legs = share["thighs"] + share["shanks"] * (self.uniform(count, 1) > 0.25)  # the others wear shorts
        cloth = shirt * worn + (trousers + flare) * legs + self._seat(count)
        folds = torch.zeros(count, len(skin), device=self.device)
        for _ in range(3):
            wave = self.normal(count, 3, sigma=PLACE_SPREAD)
            folds += torch.sin(wave @ skin.T + self.uniform(count, 1, high=2.0 * math.pi))
        covered = share["trunk"] + share["thighs"] + share["shanks"] + share["arms"] + share["forearms"]
        cloth = cloth * (1.0 + 0.3 * folds) + self.normal(count, 1, sigma=0.002) * covered
        hair = (self.uniform(count, 1) ** 3 * 0.06) * (skin[:, 0] < 0.12) * share["head"]
        return (cloth + hair)[:, :, None] * normals + self._shoes(count), 0.5 * (shirt + trousers)[:, 0]

    def _seat(self, count: int) -> torch.Tensor:
        """(n, v) m: cloth spans the gap between the thighs, of gowns further down, so that legs seem to begin lower."""
        wide = self.uniform(count, 1) ** 1.5 * torch.where(self.uniform(count, 1) < 0.1, 0.12, 0.06)
        long = self.uniform(count, 1, low=0.1, high=0.4)
        high = (1.0 - (0.82 - self.vertices[:, 1]).abs() / long).clamp(0.0, 1.0)
        inward = (-torch.sign(self.vertices[:, 2]) * self.normals[:, 2] - self.normals[:, 1].clamp_max(0.0)).clamp(0, 1)
        return wide * high * inward * self.share["thighs"]

    def _shoes(self, count: int) -> torch.Tensor:
        """(n, v, 3) m: soles, caps of toes and leather; some go without."""
        shod = self.share["feet"] * (self.uniform(count, 1) > 0.15)
        sole = self.uniform(count, 1, low=0.005, high=0.035) * (self.normals[:, 1] < -0.3)
        cap = self.uniform(count, 1, high=0.03) * (self.normals[:, 0] > 0.3)
        leather = self.uniform(count, 1, low=0.002, high=0.01)[..., None] * self.normals
        return shod[..., None] * (leather + torch.stack([cap, -sole, torch.zeros_like(sole)], dim=2))

    def _turns(self, posture: torch.Tensor, facing: torch.Tensor) -> torch.Tensor:
        """(n, b, 3, 3) turns of all bones about their parents."""
        count = len(posture)
        is_a = {name: posture == i for i, name in enumerate(POSTURES)}
        vectors = torch.zeros(count, len(self.parents), 3, device=self.device)
        flex = torch.where(
            is_a["bends"], self.uniform(count, low=0.2, high=0.55), self.normal(count, sigma=0.08) + 0.04
        )
        for name in ("LowerBack", "Spine", "Spine1"):
            vectors[:, self.asset.bone(name)] = self.normal(count, 3, sigma=0.08)
            vectors[:, self.asset.bone(name), 2] -= flex
        for name in ("Neck", "Neck1", "Head"):
            vectors[:, self.asset.bone(name)] = self.normal(count, 3) * self._row(0.08, 0.22, 0.14)
        for side, _ in SIDES:
            self._leg(vectors, side, is_a)
            vectors[:, self.asset.bone(f"{side}Hand")] = self.normal(count, 3, sigma=0.25)
            vectors[:, self.asset.bone(f"{side}Shoulder")] = self.normal(count, 3, sigma=0.1)
        turns = _matrices(vectors)
        for side, way in SIDES:
            turns[:, self.asset.bone(f"{side}Arm")] = self._upper_arm(count, side, way)
            axes, _ = hinge_axes(self.asset, f"{side}ForeArm")
            often = torch.where(self.uniform(count) < 0.35, 1.0, self.uniform(count))  # who holds bars bends elbows
            bend = self.uniform(count, low=-0.65, high=1.9) * often + self.normal(count, sigma=0.1)
            turned = bend[:, None] * self._tensor(axes[0]) + self.normal(count, 1, sigma=0.5) * self._tensor(axes[2])
            turns[:, self.asset.bone(f"{side}ForeArm")] = _matrices(turned)
        turns[:, 0] = self._root(is_a, facing)
        return turns

    def _row(self, *values: float) -> torch.Tensor:
        return torch.tensor(values, device=self.device)

    def _leg(self, vectors: torch.Tensor, side: str, is_a: dict[str, torch.Tensor]) -> None:
        count = len(vectors)
        hip, knee = self.normal(count, sigma=0.2) + 0.12, self.normal(count, sigma=0.15).abs() + 0.05
        seated, low = is_a["sits"], is_a["squats"]
        hip = torch.where(seated, self.uniform(count, low=1.1, high=1.8), hip)
        knee = torch.where(seated, self.uniform(count, low=0.6, high=2.0), knee)
        depth = self.uniform(count, low=0.5, high=2.0)
        hip, knee = torch.where(low, depth, hip), torch.where(low, depth * self.uniform(count, low=0.9, high=1.4), knee)
        far = is_a["lunges"] | is_a["anyhow"] | (is_a["lies"] & (self.uniform(count) < 0.5))
        hip = torch.where(far, self.uniform(count, low=-0.4, high=1.8), hip)
        knee = torch.where(far, self.uniform(count, low=0.0, high=2.2), knee)
        axes, _ = hinge_axes(self.asset, f"{side}Leg")
        kneels, steps = is_a["kneels"], self.uniform(count) < 0.2  # one foot before the other knee
        hip = torch.where(kneels, torch.where(steps, hip + 1.3, self.uniform(count, low=-0.1, high=1.3)), hip)
        bent = torch.where(steps, self.uniform(count, low=1.2, high=1.9), self.uniform(count, low=1.4, high=2.5))
        knee = torch.where(kneels, bent, knee)
        wide = torch.where(is_a["anyhow"] | seated, 0.3, 0.13)
        out = self.normal(count) * wide
        vectors[:, self.asset.bone(f"{side}UpLeg")] = torch.stack([out, self.normal(count, sigma=0.25), hip], dim=1)
        vectors[:, self.asset.bone(f"{side}Leg")] = knee[:, None] * self._tensor(axes[0])
        vectors[:, self.asset.bone(f"{side}Foot")] = self.normal(count, 3, sigma=0.18)

    def _upper_arm(self, count: int, side: str, way: float) -> torch.Tensor:
        """Arms hang, reach forward, point up, or anywhere before and beside the trunk."""
        kind = self.uniform(count)
        up = self.uniform(count, low=-1.0, high=1.0).asin()
        round_ = self.uniform(count, low=-0.6, high=2.0)
        hang, reach, high = kind < 0.3, (kind >= 0.3) & (kind < 0.5), kind > 0.87
        up = torch.where(hang, self.normal(count, sigma=0.15) - 1.3, up)
        up = torch.where(reach, self.normal(count, sigma=0.4) - 0.4, up)
        round_ = torch.where(reach, self.normal(count, sigma=0.4) + 0.2, round_)
        up = torch.where(high, self.uniform(count, low=0.6, high=1.55), up)
        target = torch.stack([up.cos() * round_.cos(), up.sin(), way * up.cos() * round_.sin()], dim=1)
        bone = self.asset.bone(f"{side}Arm")
        rest = self._tensor(self.asset.bone_tails[bone] - self.asset.bone_heads[bone])
        rest = (rest / rest.norm()).expand(count, 3)
        axis = torch.linalg.cross(rest, target)
        sine = axis.norm(dim=1, keepdim=True).clamp_min(1e-6)
        angle = torch.atan2(sine, (rest * target).sum(dim=1, keepdim=True))
        twist = self.normal(count, 1, sigma=0.7) * target
        return _matrices(twist) @ _matrices(axis / sine * angle)

    def _root(self, is_a: dict[str, torch.Tensor], facing: torch.Tensor) -> torch.Tensor:
        count = len(facing)
        turn = torch.zeros(count, 3, device=self.device)
        turn[:, 1] = facing
        tilt = self.normal(count, 3, sigma=0.1)
        tilt[:, 2] -= torch.where(is_a["bends"] | is_a["squats"], self.uniform(count, low=0.0, high=0.7), 0.0)
        tilt += is_a["anyhow"][:, None] * self.normal(count, 3, sigma=0.5)
        flat = torch.zeros(count, 3, device=self.device)
        flat[:, 2] = torch.where(self.uniform(count) < 0.7, 1.5, -1.5)
        roll = torch.zeros(count, 3, device=self.device)
        roll[:, 1] = self.normal(count, sigma=0.6)
        laid = _matrices(flat) @ _matrices(roll)
        lies = is_a["lies"][:, None, None]
        return _matrices(turn) @ torch.where(lies, laid, _matrices(tilt))

    def _forward(self, turns: torch.Tensor, heads: torch.Tensor) -> torch.Tensor:
        """(n, b, 4, 4): forward kinematics about the heads of the bones."""
        count = len(turns)
        found: list[torch.Tensor] = []
        for bone, parent in enumerate(self.parents):
            here = torch.eye(4, device=self.device).repeat(count, 1, 1)
            here[:, :3, :3] = turns[:, bone]
            here[:, :3, 3] = heads[:, bone] - torch.einsum("nij,nj->ni", turns[:, bone], heads[:, bone])
            found.append(here if parent < 0 else found[parent] @ here)
        return torch.stack(found, dim=1)


def _normals(asset: BodyAsset) -> np.ndarray:
    corners = asset.vertices[asset.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(asset.vertices)
    for corner in range(3):
        np.add.at(normals, asset.faces[:, corner], across)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _matrices(vectors: torch.Tensor) -> torch.Tensor:
    """Rotation matrices (..., 3, 3) of rotation vectors."""
    angle = vectors.norm(dim=-1, keepdim=True).clamp_min(1e-8)
    x, y, z = (vectors / angle).unbind(dim=-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(*vectors.shape[:-1], 3, 3)
    angle = angle[..., None]
    return torch.eye(3, device=vectors.device) + angle.sin() * cross + (1.0 - angle.cos()) * (cross @ cross)
