"""Measure how long the patient's knees, hips and trunk are extended, with and without help, and with how many hands the
patient holds on to equipment.

Rejc et al. 2015 (doi:10.1371/journal.pone.0133998) call standing independent if nobody assists hips and knees, even if
the hands hold a frame for balance; Harkema et al. 2011 (doi:10.1016/S0140-6736(11)60547-3) report standing with
assistance for balance only. This project itself defines the limits of extension, and which contacts count for which
part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final, NamedTuple

import numpy as np
from pydantic import Field

from anchorpose.joints import JOINT_INDEX, LOST, STATE_CODE, JointState
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.frame_time import runs_of_known
from anchorpose.results.records import Contact, Measure, with_people
from anchorpose.results.stand_training.event import NO_ONSET, latency_sigma_s
from anchorpose.results.stand_training.stance import SIDES, Session, Stance, hold, known, unknown
from anchorpose.results.stand_training.touch import (
    NEVER_FOUND,
    NO_CONTACTS,
    NO_EQUIPMENT,
    NO_UPRIGHT,
    sigma_of_time,
    touch_of,
)
from anchorpose.results.tables import NOT_UPRIGHT, UPRIGHT, AngleTable
from anchorpose.results.uncertainty import ANGLE_SHARE, systematic_sigma
from anchorpose.settings import settings

NOT_KNOWN: Final = "the patient was never known to be upright with this part's angle known"

_Degrees = Annotated[float, Field(gt=0, lt=90)]


@settings
class IndependenceConfig:
    """Settings of when knee, hip and trunk count as extended: extension begins when a knee or hip is bent, or the trunk
    inclined, by at most ``extended_deg``, and ends above ``bent_deg``.
    """

    # degrees, maximum bend: in walking, a knee that takes over the load bends by about 20 degrees and still carries the
    # body
    extended_deg: _Degrees = 20.0
    # degrees; 5 above extended_deg, so that errors (of 3 to 5 degrees) do not end an extension
    bent_deg: _Degrees = 25.0

    def __post_init__(self) -> None:
        if self.bent_deg < self.extended_deg:
            raise ValueError(f"bent_deg must not be below extended_deg, got {self.bent_deg} and {self.extended_deg}")


class _Part(NamedTuple):
    """A body part whose extension is measured. angle: the name of the part's angle, None for the trunk's inclination.
    regions: regions of the body where a contact helps to extend the part. beside: regions next to ``regions``; a hand
    near the border between them may be reported in either. joints: joints at ``regions``; if such a joint is unseen, a
    hand that holds the part may be unseen, too.
    """

    name: str
    side: str | None
    angle: str | None
    regions: tuple[str, ...]
    beside: tuple[str, ...]
    joints: tuple[str, ...]


def _parts() -> tuple[_Part, ...]:
    knees = [
        _Part(
            "knee",
            s,
            f"knee_flexion_{s}",
            (f"thigh_{s}", f"knee_{s}", f"shank_{s}"),
            ("pelvis", f"foot_{s}"),
            (f"Knee{s.capitalize()}",),
        )
        for s in SIDES
    ]
    hips = [
        _Part(
            "hip",
            s,
            f"hip_flexion_{s}",
            ("pelvis", f"thigh_{s}"),
            ("belly", f"knee_{s}"),
            (f"Hip{s.capitalize()}", "SpineBase"),
        )
        for s in SIDES
    ]
    trunk = ("neck_and_shoulders", "chest", "belly")
    beside = ("head", "upper_arm_left", "upper_arm_right", "pelvis")
    return (*knees, *hips, _Part("trunk", None, None, trunk, beside, ("SpineMid", "SpineShoulder")))


PARTS: Final = _parts()


def independence_measures(session: Session) -> list[Measure]:
    """Return, for each part: the time for which it is extended; the time until it is first extended; the time extended
    without another person's hand on the part; and the time, the number of bouts and the longest bout extended with
    neither such a hand nor equipment on the part. Also return bouts upright without help, and the upright time for each
    number of hands with which the patient holds on.
    """
    rows = list[Measure]()
    for part in PARTS:
        rows += _extension(session, part)
    return [*rows, *_unaided(session), *_holding(session)]


class _Extended(NamedTuple):
    """The frames in which a part is extended. is_known (n,) bool: upright, and the angle is known; decided (n,) bool:
    is_known, or known not to be upright. frames (n,) bool: is_known and extended; less, more (n,) bool: frames that
    would be extended if all angles were larger, or smaller, by their systematic sigma. sigma_s: sigma of the extended
    time due to such errors. codes (n,): worst state of the joints used.
    """

    is_known: np.ndarray
    decided: np.ndarray
    frames: np.ndarray
    less: np.ndarray
    more: np.ndarray
    sigma_s: float
    codes: np.ndarray


def extended_states(angles: AngleTable, found: Stance, config: IndependenceConfig) -> np.ndarray:
    """Return (n, 5, 3) bool: whether each of ``PARTS`` is extended if all angles are larger by their systematic sigma,
    as measured, and smaller by this sigma.

    An extended part stays extended until its angle exceeds ``bent_deg`` (hysteresis). A knee bent backwards (a negative
    angle) counts as extended.
    """
    states = np.zeros((len(angles.frame), len(PARTS), 3), dtype=bool)
    for number, part in enumerate(PARTS):
        degrees, sigma = _bend(angles, found, part)
        for place, shift in enumerate((1.0, 0.0, -1.0)):
            bend = degrees + shift * systematic_sigma(sigma, ANGLE_SHARE)
            held = hold(bend <= config.extended_deg, bend > config.bent_deg, np.isfinite(bend))
            states[:, number, place] = held == UPRIGHT
    return states


def _bend(angles: AngleTable, found: Stance, part: _Part) -> tuple[np.ndarray, np.ndarray]:
    """Return the angle (n,) in degrees by which a part is bent (of the trunk: inclined), and the sigma (n,) of this
    angle.
    """
    if part.angle is None:
        return found.trunk_deg, found.trunk_sigma_deg
    column = angles.column(part.angle)
    return angles.degrees[:, column], angles.sigma_deg[:, column]


def _extended(session: Session, part: _Part) -> _Extended:
    if part.angle is None:
        codes = session.joints.state_code[:, [JOINT_INDEX["SpineBase"], JOINT_INDEX["SpineShoulder"]]].max(axis=1)
    else:
        codes = session.angle(part.angle).state_code
    is_known = session.upright & np.isfinite(_bend(session.angles, session.stance, part)[0])
    less, frames, more = (session.extended[:, PARTS.index(part)] & is_known[:, None]).T
    sigma_s = 0.5 * float(session.seconds[more].sum() - session.seconds[less].sum())
    decided = is_known | (session.posture.upright == NOT_UPRIGHT)
    return _Extended(is_known, decided, frames, less, more, sigma_s, codes)


def _extension(session: Session, part: _Part) -> list[Measure]:
    name, found = f"{part.name}_extended", _extended(session, part)
    names = {f"{name}_{what}": unit for what, unit in _EXTENSION.items()}
    if not found.is_known.any():
        return [unknown(measure, unit, NOT_KNOWN, part.side) for measure, unit in names.items()]
    rows = [_row(session, part, f"{name}_time", found, _Free(found.frames, 0.0)), _latency(session, part, found)]
    if session.helping is None:
        return rows + [unknown(measure, names[measure], NO_CONTACTS, part.side) for measure in list(names)[2:]]
    rows.append(_row(session, part, f"{name}_hands_off_time", found, _free(session, part, found, session.helping)))
    alone = [f"{name}_alone_{what}" for what in ("time", "bouts", "longest")]
    if session.supports is None:
        return rows + [unknown(measure, names[measure], NO_EQUIPMENT, part.side) for measure in alone]
    free = _free(session, part, found, (*session.helping, *session.supports))
    runs = runs_of_known(free.frames, found.decided, session.joints.time_s)
    codes = found.codes[found.is_known]
    return [
        *rows,
        _row(session, part, alone[0], found, free),
        known(alone[1], "count", float(len(runs)), codes, side=part.side),
        _row(session, part, alone[2], found, free, longest=True),
    ]


_EXTENSION: Final = {
    "time": "s",
    "latency": "s",
    "hands_off_time": "s",
    "alone_time": "s",
    "alone_bouts": "count",
    "alone_longest": "s",
}


EXTENDED_BEFORE: Final = "it was extended from the first frame on"
NEVER_EXTENDED: Final = "it was never extended"


def _latency(session: Session, part: _Part, found: _Extended) -> Measure:
    """Return the seconds from the first frame (or the onset of the trial) until the part is first extended.

    Sigma includes the possibility of an earlier extension in frames in which the angle is unknown.
    """
    name, time_s = f"{part.name}_extended_latency", session.joints.time_s
    if not session.onset_seen:
        return unknown(name, "s", NO_ONSET, part.side, found.codes[found.is_known])
    if not found.frames.any() or found.frames[0]:
        why = EXTENDED_BEFORE if found.frames.any() else NEVER_EXTENDED
        return unknown(name, "s", why, part.side, found.codes[found.is_known])
    first = int(np.argmax(found.frames))
    early, late = (int(np.argmax(some)) if some.any() else len(time_s) - 1 for some in (found.more, found.less))
    unsure_s = float(session.seconds[:first][~found.decided[:first]].sum()) / np.sqrt(3.0)
    sigma_s = np.hypot(0.5 * (time_s[late] - time_s[early]), unsure_s)
    codes = found.codes[first : first + 1]
    value = float(time_s[first] - session.onset_s)
    return known(name, "s", value, codes, latency_sigma_s(time_s, float(sigma_s)), part.side)


class _Free(NamedTuple):
    """The frames in which a part is extended without contact. frames (n,) bool: extended, and no contact is reported;
    unsure_s: seconds in which it is uncertain whether a contact existed.
    """

    frames: np.ndarray
    unsure_s: float


def _free(session: Session, part: _Part, found: _Extended, contacts: Sequence[Contact]) -> _Free:
    """Return the frames in which the part is extended and has none of the ``contacts``.

    A frame is uncertain in three cases: a reported contact that no camera sees may not exist; a contact with an unseen
    part may be missing; a person's hand that is reported beside the part may be on it.
    """
    frame, people = session.joints.frame, with_people(contacts)
    touch = touch_of(frame, [contact for contact in contacts if contact.part in part.regions])
    beside = touch_of(frame, [contact for contact in people if contact.part in part.beside]).at_once > 0
    touched = touch.at_once > 0
    joints = [JOINT_INDEX[name] for name in part.joints]
    hidden = (session.joints.state_code[:, joints] != OBSERVED).any(axis=1)
    unsure = np.where(touched, 1.0 - touch.seen, hidden | beside)
    return _Free(found.frames & ~touched, float((unsure * session.seconds)[found.frames].sum()))


OBSERVED: Final = STATE_CODE[JointState.OBSERVED]


def _row(session: Session, part: _Part, measure: str, found: _Extended, free: _Free, longest: bool = False) -> Measure:
    """Return a measure: the total time of the frames of ``free``, or the time of their longest unbroken bout if
    ``longest``.
    """
    runs = runs_of_known(free.frames, found.decided, session.joints.time_s)
    value = _longest_s(session, free.frames, runs) if longest else float(session.seconds[free.frames].sum())
    sigma = float(np.hypot(found.sigma_s, _sigma_s(session, len(runs), free.unsure_s)))
    return known(measure, "s", value, found.codes[found.is_known], sigma, part.side)


def _longest_s(session: Session, frames: np.ndarray, runs: Sequence[slice]) -> float:
    """Return the time of the ``frames`` (n,) bool in the run in which this time is longest; 0 without runs."""
    return max((float(session.seconds[run][frames[run]].sum()) for run in runs), default=0.0)


def _sigma_s(session: Session, bouts: int, unsure_s: float) -> float:
    """Return sigma of a time without contacts. The reported time is the upper limit of the true time.

    The true time may be less than the reported time by up to ``unsure_s``. If the true time is uniformly distributed
    over this range, its root-mean-square distance from the reported upper limit is ``unsure_s`` / sqrt(3), twice its
    root-mean-square distance from the middle of the range.
    """
    return sigma_of_time(2 * bouts, 2.0 * unsure_s, session.seconds)


def _unaided(session: Session) -> list[Measure]:
    """Return measures of bouts upright without another person's hand on the patient; their total time is
    ``hands_free_upright_time``.
    """
    names = {"hands_free_upright_bouts": "count", "hands_free_upright_longest": "s"}
    helping = session.helping
    if helping is None or not session.upright.any():
        return [unknown(name, unit, _why_unknown(session, helping, NO_CONTACTS)) for name, unit in names.items()]
    touch = touch_of(session.joints.frame, helping)
    free = session.upright & session.found & (touch.at_once == 0)
    is_known = session.found & (session.posture.upright != UNKNOWN)
    runs = runs_of_known(free, is_known, session.joints.time_s)
    longest_s = _longest_s(session, free, runs)
    touched = session.upright & (touch.at_once > 0)
    unsure_s = float(((1.0 - touch.seen) * session.seconds)[touched].sum())
    codes = session.stance.state_code[session.upright]
    sigma = _sigma_s(session, len(runs), unsure_s)
    return [
        known("hands_free_upright_bouts", "count", float(len(runs)), codes),
        known("hands_free_upright_longest", "s", longest_s, codes, sigma),
    ]


def _why_unknown(session: Session, contacts: Sequence[Contact] | None, without: str) -> str:
    """Return the reason why measures of upright time have no value: ``without`` if the contacts are unknown, else that
    the patient was never upright or never found.
    """
    return without if contacts is None else NO_UPRIGHT if session.found.any() else NEVER_FOUND


HOLDING: Final = ("upright_two_hands_time", "upright_one_hand_time", "upright_no_hands_time")


def _holding(session: Session) -> list[Measure]:
    """Return the times upright with two hands, one hand and no hand on the equipment. A forearm that rests on the
    equipment counts as a hand.

    If a hand is lost and has no reported contact in a frame, this frame counts for none of the three times. A hand that
    is hidden or lost makes all three times uncertain.
    """
    supports = session.supports
    if supports is None or not session.upright.any():
        return [unknown(name, "s", _why_unknown(session, supports, NO_EQUIPMENT)) for name in HOLDING]
    touches = [
        touch_of(session.joints.frame, [c for c in supports if c.part in (f"hand_{side}", f"forearm_{side}")])
        for side in SIDES
    ]
    codes = session.joints.state_code[:, [JOINT_INDEX["HandLeft"], JOINT_INDEX["HandRight"]]]
    holds = np.stack([touch.at_once > 0 for touch in touches], axis=1)
    seen = np.stack([touch.seen for touch in touches], axis=1)
    lost = ((codes == LOST) & ~holds).any(axis=1)
    unsure = np.where(holds, 1.0 - seen, codes != OBSERVED).max(axis=1)
    hands, standing = holds.sum(axis=1), session.upright
    unsure_s = float((unsure * session.seconds)[standing].sum())
    rows, is_known = list[Measure](), session.posture.upright != UNKNOWN
    for name, count in zip(HOLDING, (2, 1, 0), strict=True):
        frames = standing & (hands == count) & ~lost
        edges = 2 * len(runs_of_known(frames, is_known, session.joints.time_s))
        sigma = sigma_of_time(edges, unsure_s, session.seconds)
        value, worst = float(session.seconds[frames].sum()), codes[standing].max(axis=1)
        rows.append(known(name, "s", value, worst, sigma))
    return rows
