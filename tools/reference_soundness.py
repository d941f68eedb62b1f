"""Where another tracker's skeleton can be judged against: a criterion that knows nothing of our track.

Four things are asked of a reference skeleton, of the depth picture and of itself alone (camera axes: x right, y down,
z away, metres). A frame in which a limb's worth of the body is far from all its bones has no reference. The legs have
none where they are laid through each other, a joint where it is not on the body, nor both ends of a bone whose length
is not the subject's. All of it takes away hard frames as well as wrong ones, and misses what is wrong near the body
(an arm laid on the chest): give the raw share beside it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FAR_M = 0.2  # from every bone: twice the thickness of an arm, and more than from a spine to the skin of the belly
LIMB_M2 = 0.02  # skin that a camera sees of half a forearm with its hand: 0.25 m by 0.08 m
OWN_LENGTH_SHARE = 0.2  # a bone's length against the subject's median: more is no noise
FRAMES_NEEDED = 10  # for that median
ON_BODY_PX, ON_BODY_M = 6, 0.2  # "on the body", as the data's own description has it
CROSSED_ABOVE = 0.75  # thighs that cross nearer to the hips than this share of their length would pass through flesh
FACING = 0.5  # of the hips' distance must lie across the picture, else thighs cross in it and not in space
SHANKS_APART_M = 0.08  # two shanks nearer than this are one: so thick is the thinner one

SEGMENTS = (
    ("Head", "SpineShoulder"), ("SpineShoulder", "SpineMid"), ("SpineMid", "SpineBase"),
    *((start + side, end + side) for side in ("Left", "Right") for start, end in (
        ("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Wrist", "Hand"), ("Hip", "Knee"), ("Knee", "Ankle"),
        ("Ankle", "Foot"))),
    ("ShoulderLeft", "SpineShoulder"), ("ShoulderRight", "SpineShoulder"),
    ("HipLeft", "SpineBase"), ("HipRight", "SpineBase"), ("ShoulderLeft", "HipLeft"), ("ShoulderRight", "HipRight"),
)  # fmt: skip
"""What may explain a pixel: all bones, and the sides of the trunk."""

RIGID = tuple(
    (start + side, end + side)
    for side in ("Left", "Right")
    for start, end in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Hip", "Knee"), ("Knee", "Ankle"))
)
"""Bones from one end to the other; their length is the subject's own."""

Bool = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """The person's pixels of one picture: mask (h, w) bool, points_m (h, w, 3) camera axes, pixel_m2 (h, w) of skin
    that faces the camera. What is not on the mask means nothing."""

    mask: Bool
    points_m: np.ndarray
    pixel_m2: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Soundness:
    """What is wrong with a reference of t frames and m joints.

    unexplained (t, m) bool: of a frame in which a limb's worth of the body is far from all bones. tangled (t, m) bool:
    of legs that are laid through each other. off_body (t, m) bool. wrong_length (t, m) bool: an end of a bone whose
    length is not the subject's.
    """

    unexplained: Bool
    tangled: Bool
    off_body: Bool
    wrong_length: Bool

    @property
    def sound(self) -> Bool:
        """(t, m) joints that can be judged against."""
        return ~(self.unexplained | self.tangled | self.off_body | self.wrong_length)


def judge(
    bodies: Iterable[Body], reference_m: np.ndarray, pixels: np.ndarray, sure: Bool, own_m: np.ndarray,
    names: tuple[str, ...],
) -> Soundness:  # fmt: skip
    """One sequence: a body a frame, reference_m (t, m, 3), pixels (t, m, 2), sure (t, m), the ``own_lengths``.

    Missing joints are NaN.
    """
    shape = sure.shape
    unexplained, tangled, off = (np.zeros(shape, dtype=bool) for _ in range(3))
    legs = np.array([name.startswith(("Hip", "Knee", "Ankle", "Foot")) for name in names])
    for row, (body, joints_m) in enumerate(zip(bodies, reference_m, strict=True)):
        unexplained[row] = unexplained_m2(body, joints_m, names) > LIMB_M2
        tangled[row] = legs & legs_tangled(joints_m, names)
        off[row] = off_body(body, joints_m, pixels[row])
    return Soundness(unexplained, tangled, off, wrong_length(reference_m, sure, own_m, names))


def unexplained_m2(body: Body, joints_m: np.ndarray, names: tuple[str, ...]) -> float:
    """Skin area of the largest connected patch of the body that is farther than ``FAR_M`` from every bone.

    joints_m (m, 3); a bone with an end that is missing (NaN) explains nothing.
    """
    import cv2

    points_m = body.points_m[body.mask]
    left = np.arange(len(points_m))  # that no bone explains so far
    for start_m, end_m in _segments(joints_m, names, SEGMENTS):
        left = left[_distance_to_segment(points_m[left], start_m, end_m) > FAR_M]
    far = np.zeros(body.mask.shape, np.uint8)
    far[tuple(place[left] for place in np.nonzero(body.mask))] = 1
    count, patch = cv2.connectedComponents(far)
    area = np.bincount(patch[body.mask], weights=body.pixel_m2[body.mask], minlength=count)
    return float(area[1:].max(initial=0.0))


def legs_tangled(joints_m: np.ndarray, names: tuple[str, ...]) -> bool:
    """Whether the thighs cross where thighs cannot, or both shanks are laid in one leg; joints_m (m, 3).

    Where an end is missing (NaN), nothing is said of its bone.
    """
    thighs, shanks = (
        _segments(joints_m, names, ((start + "Left", end + "Left"), (start + "Right", end + "Right")))
        for start, end in (("Hip", "Knee"), ("Knee", "Ankle"))
    )
    if len(shanks) == 2 and _distance_of_segments(*shanks) < SHANKS_APART_M:
        return True
    return len(thighs) == 2 and _crossed_high(*thighs)


def _crossed_high(left: tuple[np.ndarray, np.ndarray], right: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether two thighs seen from the front or the back cross in the picture above the knees."""
    across = left[0][:2] - right[0][:2]
    if np.linalg.norm(across) < FACING * np.linalg.norm(left[0] - right[0]):
        return False
    sides = np.stack([(right[1] - right[0])[:2], (left[0] - left[1])[:2]], axis=1)
    if abs(np.linalg.det(sides)) < 1e-6:  # parallel: 1 mm over 1 mm
        return False
    shares = np.linalg.solve(sides, across)
    return bool(((shares > 0.0) & (shares < CROSSED_ABOVE)).all())


def off_body(body: Body, joints_m: np.ndarray, pixels: np.ndarray) -> Bool:
    """(m,) joints with no pixel of the body within ``ON_BODY_PX`` of theirs and ``ON_BODY_M`` of their depth.

    pixels (m, 2) column and row of joints_m (m, 3); a missing joint (NaN) is off.
    """
    off = np.ones(len(joints_m), dtype=bool)
    for j, ((column, row), depth) in enumerate(zip(pixels, joints_m[:, 2], strict=True)):
        if not np.isfinite([column, row, depth]).all():
            continue
        rows = slice(max(0, round(row) - ON_BODY_PX), max(0, round(row) + ON_BODY_PX + 1))
        columns = slice(max(0, round(column) - ON_BODY_PX), max(0, round(column) + ON_BODY_PX + 1))
        near = body.mask[rows, columns] & (np.abs(body.points_m[rows, columns, 2] - depth) <= ON_BODY_M)
        off[j] = not near.any()
    return off


def own_lengths(references_m: list[np.ndarray], sure: list[Bool], names: tuple[str, ...]) -> np.ndarray:
    """(bones,) the median length of each of ``RIGID`` over all sequences of one subject, (t, m, 3) and (t, m) each.

    NaN where both ends are sure in fewer than ``FRAMES_NEEDED`` frames.
    """
    lengths = np.concatenate([_lengths(*of) for of in zip(references_m, sure, [names] * len(sure), strict=True)])
    few = np.isfinite(lengths).sum(axis=0) < FRAMES_NEEDED
    return np.where(few, np.nan, np.nanmedian(np.where(few, 0.0, lengths), axis=0))


def wrong_length(reference_m: np.ndarray, sure: Bool, own_m: np.ndarray, names: tuple[str, ...]) -> Bool:
    """(t, m) both ends of each bone that is not as long as the subject's, by more than ``OWN_LENGTH_SHARE``.

    Where an end is not sure, or the subject's length is unknown, nothing is said.
    """
    wrong = np.zeros(sure.shape, dtype=bool)
    odd = np.abs(_lengths(reference_m, sure, names) / own_m - 1.0) > OWN_LENGTH_SHARE
    for of_bone, ends in zip(odd.T, RIGID, strict=True):
        for end in ends:
            wrong[:, names.index(end)] |= of_bone
    return wrong


def _lengths(reference_m: np.ndarray, sure: Bool, names: tuple[str, ...]) -> np.ndarray:
    """(t, bones) length of each of ``RIGID``, NaN where an end is not sure."""
    known = np.where(sure[..., None], reference_m, np.nan)
    ends = [(names.index(start), names.index(end)) for start, end in RIGID]
    return np.stack([np.linalg.norm(known[:, start] - known[:, end], axis=1) for start, end in ends], axis=1)


def _segments(
    joints_m: np.ndarray, names: tuple[str, ...], bones: tuple[tuple[str, str], ...]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Both ends of the bones that have both."""
    ends = [(joints_m[names.index(start)], joints_m[names.index(end)]) for start, end in bones]
    return [(start, end) for start, end in ends if np.isfinite([start, end]).all()]


def _distance_to_segment(points_m: np.ndarray, start_m: np.ndarray, end_m: np.ndarray) -> np.ndarray:
    """(n,) distance of points (n, 3) to a segment."""
    along = end_m - start_m
    share = np.clip((points_m - start_m) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points_m - start_m - share[:, None] * along, axis=1))


def _distance_of_segments(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> float:
    """Least distance of two segments, to a hundredth of their length."""
    along = np.linspace(one[0], one[1], 101)
    return float(_distance_to_segment(along, *other).min())
