"""Decide whether the patient is upright in each frame, and define ``Session``, the inputs of all measures.

Whether the patient is upright is decided by the inclination of thigh and trunk and the height of the pelvis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from anchorpose.joints import JOINT_INDEX, LOST
from anchorpose.results.angle_definition import AngleGroup, Points, Reading, length
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import longest_known_gap_s
from anchorpose.results.joint_angles import angles_with_sigma
from anchorpose.results.records import (
    SIT_TO_STAND,
    STAND_TO_SIT,
    Contact,
    Episode,
    Measure,
    with_equipment,
    with_people,
)
from anchorpose.results.tables import NOT_UPRIGHT, UPRIGHT, AngleTable, JointTable, PostureTable
from anchorpose.rotations import unit
from anchorpose.settings import Positive, settings


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """How the patient stands or sits in every frame; NaN where a joint is lost. Each value except ``behind_m`` has a
    standard deviation.

    thigh_deg (n,): angle between the vertical and the thigh that is nearer to it, 0 = thigh straight down from the hip.
    The nearer thigh counts, since a patient who raises one leg stands on the other leg. trunk_deg (n,): angle of the
    line from SpineBase to SpineShoulder against the vertical, in any direction. height (n,): height of the midpoint of
    the hips above the lower ankle, in leg lengths: 1 = standing straight. behind_m (n,): distance of the centre of mass
    behind the midpoint of the ankles.
    """

    thigh_deg: np.ndarray
    thigh_sigma_deg: np.ndarray
    trunk_deg: np.ndarray
    trunk_sigma_deg: np.ndarray
    height: np.ndarray
    height_sigma: np.ndarray
    behind_m: np.ndarray
    state_code: np.ndarray


def stance(joints: JointTable, mass_m: np.ndarray) -> Stance:
    """Compute the stance from the joints and the centre of mass (n, 3); the leg's length is the median over the
    recording.
    """
    position_m, sigma_m = joints.position_m.transpose(1, 2, 0), joints.sigma_m.T
    (thigh, trunk), (thigh_sigma, trunk_sigma) = (
        np.degrees(found) for found in angles_with_sigma(_INCLINATIONS, position_m, sigma_m)
    )
    height_m, height_sigma_m = _pelvis_height(joints)
    leg_m = _leg_length(joints)
    return Stance(
        thigh,
        thigh_sigma,
        trunk,
        trunk_sigma,
        height_m / leg_m,
        height_sigma_m / leg_m,
        _behind_feet(joints.position_m, mass_m),
        stance_state(joints),
    )


def stance_state(joints: JointTable) -> np.ndarray:
    """Return the worst state code (n,) of the joints that ``stance`` uses."""
    used = [*(JOINT_INDEX[name] for name in _INCLINATIONS.joints), *ANKLES]
    return np.asarray(joints.state_code[:, used].max(axis=1))


ANKLES: Final = [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["AnkleRight"]]
SIDES: Final = ("left", "right")
OTHER_SIDE: Final = {"left": "right", "right": "left"}


def _inclinations(points: Points) -> tuple[Reading, ...]:
    thighs = [_from_vertical(points[f"Hip{side}"] - points[f"Knee{side}"]) for side in ("Left", "Right")]
    trunk = _from_vertical(points["SpineShoulder"] - points["SpineBase"])
    return (np.minimum(*thighs), 1.0), (trunk, 1.0)


def _from_vertical(line: np.ndarray) -> np.ndarray:
    angle: np.ndarray = np.arctan2(np.hypot(line[0], line[2]), line[1])
    return np.where(length(line) > 0, angle, np.nan)


_INCLINATIONS: Final = AngleGroup(
    ("thigh", "trunk"), ("HipLeft", "KneeLeft", "HipRight", "KneeRight", "SpineBase", "SpineShoulder"), _inclinations
)


def _pelvis_height(joints: JointTable) -> tuple[np.ndarray, np.ndarray]:
    """Return the height (n,) in m of the pelvis above the lower ankle (whose foot is taken to be on the floor), and the
    sigma of this height.
    """
    height, variance = joints.position_m[..., 1], joints.sigma_m**2
    hips, both_m = [JOINT_INDEX["HipLeft"], JOINT_INDEX["HipRight"]], height[:, ANKLES]
    sigma_m = np.sqrt(variance[:, hips].sum(axis=1) / 4.0 + variance[:, ANKLES].mean(axis=1))
    # if an ankle is lost, it is unknown which ankle is lower; so ``min`` is used, which is then NaN, and not ``nanmin``
    return height[:, hips].mean(axis=1) - both_m.min(axis=1), sigma_m


def facing(position_m: np.ndarray) -> np.ndarray:
    """Return (n, 2): the heading of the patient on the floor as x and z, perpendicular to the line through the hip
    joints. position_m (n, 21, 3): the joints.
    """
    across = position_m[:, JOINT_INDEX["HipRight"]] - position_m[:, JOINT_INDEX["HipLeft"]]
    return unit(np.stack([across[:, 2], -across[:, 0]], axis=1))


def _behind_feet(position_m: np.ndarray, mass_m: np.ndarray) -> np.ndarray:
    middle_m = position_m[:, ANKLES].mean(axis=1)
    return np.asarray(((middle_m - mass_m)[:, [0, 2]] * facing(position_m)).sum(axis=1))


def _leg_length(joints: JointTable) -> float:
    """Return the length in metres from hip to ankle along a straight leg; NaN if both legs are known in no frame."""
    legs = [[JOINT_INDEX[f"{name}{side}"] for name in ("Hip", "Knee", "Ankle")] for side in ("Left", "Right")]
    bones_m = np.diff(joints.position_m[:, legs], axis=2).reshape(-1, 4, 3)
    whole = 0.5 * np.linalg.norm(bones_m, axis=2).sum(axis=1)
    known = whole[np.isfinite(whole)]
    return float(np.median(known)) if len(known) else float("nan")


@settings
class UprightConfig:
    """Settings of when the patient counts as upright: from the frame in which thigh, pelvis and trunk all meet their
    ``enter`` limits until a frame in which any of them passes its wider ``leave`` limit (hysteresis).

    Accelerometers distinguish standing from sitting by a thigh within 45 degrees of the vertical (Skotte et al. 2014,
    doi:10.1123/jpah.2011-0347). If only the thigh were tested, kneeling and hanging over a rail would count as upright;
    the limits of the pelvis' height and of the trunk's inclination exclude these postures.
    """

    thigh_enter_deg: Positive = 40.0
    thigh_leave_deg: Positive = 45.0
    height_enter: Positive = 0.85  # leg lengths, least pelvis height, at which thigh and shank lean by about 30 degrees
    height_leave: Positive = 0.80
    trunk_enter_deg: Positive = 45.0
    trunk_leave_deg: Positive = 50.0

    def __post_init__(self) -> None:
        if self.thigh_enter_deg > self.thigh_leave_deg or self.trunk_enter_deg > self.trunk_leave_deg:
            raise ValueError("the limits that end standing must not be narrower than those that begin it")
        if self.height_leave > self.height_enter:
            raise ValueError("height_leave must not exceed height_enter")


class Limits(NamedTuple):
    """The comparison of every frame with the limits of ``UprightConfig``, as three arrays (n,) bool: whether all
    ``enter`` limits are met; whether a ``leave`` limit is passed; whether all joints needed for these limits are known.
    """

    begins: np.ndarray
    ends: np.ndarray
    known: np.ndarray


def upright_limits(stance: Stance, config: UprightConfig, shift: float = 0.0) -> Limits:
    """Test in every frame whether the ``enter`` limits are met, and whether a ``leave`` limit is passed. shift: number
    of sigmas by which every value is moved towards standing, to find the effect of errors.
    """
    thigh = stance.thigh_deg - shift * stance.thigh_sigma_deg
    trunk = stance.trunk_deg - shift * stance.trunk_sigma_deg
    height = stance.height + shift * stance.height_sigma
    begins = (thigh <= config.thigh_enter_deg) & (trunk <= config.trunk_enter_deg) & (height >= config.height_enter)
    ends = (thigh > config.thigh_leave_deg) | (trunk > config.trunk_leave_deg) | (height < config.height_leave)
    return Limits(begins, ends, np.isfinite(thigh + trunk + height))


def upright(stance: Stance, config: UprightConfig, shift: float = 0.0) -> np.ndarray:
    """Return (n,) int8: ``UPRIGHT``, ``NOT_UPRIGHT``, or ``UNKNOWN``. After a frame with a lost joint, the value stays
    ``UNKNOWN`` until a frame meets the ``enter`` limits or passes a ``leave`` limit.

    shift: number of sigmas by which every value is moved towards standing, to find the effect of errors.
    """
    return hold(*upright_limits(stance, config, shift))


def hold(begins: np.ndarray, ends: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the state in each frame, int8 (n,). The state stays the same until a frame changes it. A frame that is not
    ``known`` changes the state to -1 (unknown); otherwise a frame that ``begins`` the state changes it to 1, and a
    frame that ``ends`` the state changes it to 0. Before the first change, the state is -1.
    """
    state = np.full(len(known), UNKNOWN, dtype=np.int8)
    decisive = begins | ends | ~known
    last = np.maximum.accumulate(np.where(decisive, np.arange(len(known)), -1))
    some = last >= 0
    state[some] = np.where(~known[last[some]], UNKNOWN, np.where(begins[last[some]], UPRIGHT, NOT_UPRIGHT))
    return state


class Angle(NamedTuple):
    """One angle in all frames: columns (n,) of the ``AngleTable``."""

    degrees: np.ndarray
    sigma_deg: np.ndarray
    state_code: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """The inputs of the measures of a recording or a trial: joints, angles, posture and stance in the same frames; and
    the seconds (n,) that each frame represents.

    contacts: with people and equipment, None if the results folder has no table of them; equipment: the parts that were
    searched for contacts, empty if the recording has no model of the equipment.

    States with hysteresis are decided in the whole recording, since a state in a trial may have begun before the trial.
    shifted_upright (n, 2) int8: results of the function ``upright`` if every value is moved by one sigma away from
    standing (first column), and towards it (second column); extended (n, 5, 3) bool: whether each knee, each hip and
    the trunk is extended (``independence.extended_states``); last axis: if all angles are larger by their systematic
    sigma, as measured, and smaller by this sigma. onset_s: the time at which the recording or the trial
    begins; a trial may begin before its first frame.
    """

    joints: JointTable
    angles: AngleTable
    posture: PostureTable
    stance: Stance
    seconds: np.ndarray
    episodes: tuple[Episode, ...]
    contacts: tuple[Contact, ...] | None
    equipment: tuple[str, ...]
    shifted_upright: np.ndarray
    extended: np.ndarray
    onset_s: float

    @property
    def weights(self) -> np.ndarray:
        """Return the weight (n,) of each frame in a mean over time: the seconds that it represents, so that a mean does
        not depend on the frame rate. A single frame has the weight 1.
        """
        return self.seconds if self.seconds.any() else np.ones(len(self.seconds))

    def angle(self, name: str) -> Angle:
        """Return the angle with this name in all frames; raises ValueError for an unknown name."""
        column = self.angles.column(name)
        angles = self.angles
        return Angle(angles.degrees[:, column], angles.sigma_deg[:, column], angles.state_code[:, column])

    @property
    def helping(self) -> tuple[Contact, ...] | None:
        """Return the contacts with people; None if contacts are unknown."""
        return None if self.contacts is None else with_people(self.contacts)

    @property
    def supports(self) -> tuple[Contact, ...] | None:
        """Return the contacts with the equipment; None if contacts are unknown, or if the recording has no model of the
        equipment.
        """
        return None if self.contacts is None or not self.equipment else with_equipment(self.contacts)

    @property
    def upright(self) -> np.ndarray:
        """Return (n,) bool: frames in which the patient is known to be upright."""
        return self.posture.upright == UPRIGHT

    @property
    def maybe_upright(self) -> np.ndarray:
        """Return (n,) bool: frames in which the patient is upright; and frames with unknown posture in which the
        patient is found, if the nearest known postures before and after them are upright.
        """
        state, rows = self.posture.upright, np.arange(len(self.seconds))
        known = state != UNKNOWN
        if not known.any():
            return np.zeros(len(state), dtype=bool)
        first, last = np.flatnonzero(known)[[0, -1]]
        before = np.maximum(np.maximum.accumulate(np.where(known, rows, -1)), first)
        after = np.minimum(np.minimum.accumulate(np.where(known, rows, len(rows))[::-1])[::-1], last)
        around = (state[before] == UPRIGHT) & (state[after] == UPRIGHT)
        return np.where(known, self.upright, around & self.found)

    @property
    def onset_seen(self) -> bool:
        """Return whether the first frame follows the beginning of the recording or trial (``onset_s``) without a long
        gap (``longest_known_gap_s``); in a long gap, it would be unknown what the patient did.
        """
        time_s = self.joints.time_s
        return len(time_s) < 2 or bool(time_s[0] - self.onset_s <= longest_known_gap_s(time_s))

    @property
    def standing(self) -> np.ndarray:
        """Return (n,) bool: frames in which the patient is upright, and neither standing up nor sitting down."""
        return self.upright & ~self.moving()

    def moving(self, settle_s: float = 0.0) -> np.ndarray:
        """Return (n,) bool: frames inside a change between sitting and standing (without its two end frames), and
        frames up to settle_s after it.
        """
        time_s, changing = self.joints.time_s, np.zeros(len(self.seconds), dtype=bool)
        for episode in self.episodes:
            if episode.kind in (SIT_TO_STAND, STAND_TO_SIT):
                changing |= (time_s > episode.start_s) & (time_s < episode.end_s + settle_s)
        return changing

    @property
    def found(self) -> np.ndarray:
        """Return (n,) bool: frames in which any joint was found. In other frames contacts are unknown."""
        return self.joints.state_code.min(axis=1) < LOST


def known(
    measure: str, unit: str, value: float, state_code: np.ndarray, sigma: float | None = None, side: str | None = None
) -> Measure:
    """Return a measure with a value. state_code (k,): worst state of the joints used, in each frame used."""
    return _measure(measure, unit, state_code, value=value, sigma=sigma, side=side)


def unknown(
    measure: str, unit: str, why: str, side: str | None = None, state_code: np.ndarray | None = None
) -> Measure:
    """Return a measure without a value, with the reason. state_code (k,): worst state of the joints used, in each frame
    used; None for no frames.
    """
    codes = np.empty(0) if state_code is None else state_code
    return _measure(measure, unit, codes, value=None, why=why, side=side)


def _measure(measure: str, unit: str, state_code: np.ndarray, **values: Any) -> Measure:
    return Measure(
        measure=measure, unit=unit, frames=len(state_code), inferred_share=inferred_share(state_code), **values
    )


def inferred_share(state_code: np.ndarray) -> float | None:
    """Return the share of the frames in ``state_code`` in which a used joint was not seen; None without frames."""
    return float(np.mean(state_code > 0)) if len(state_code) else None
