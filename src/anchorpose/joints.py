"""Define the 21 joints, their order, and the limbs between them."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

JOINT_NAMES: Final = (
    "SpineBase",
    "SpineMid",
    "SpineShoulder",
    "Neck",
    "Head",
    "ShoulderLeft",
    "ElbowLeft",
    "WristLeft",
    "HandLeft",
    "ShoulderRight",
    "ElbowRight",
    "WristRight",
    "HandRight",
    "HipLeft",
    "KneeLeft",
    "AnkleLeft",
    "FootLeft",
    "HipRight",
    "KneeRight",
    "AnkleRight",
    "FootRight",
)
"""Names of the joints, in the order of all arrays of joints. They are the 25 joints of Kinect v2 without hand tips and
thumbs (paper, Section III: N_J = 21); left is the patient's left.
"""

JOINT_COUNT: Final = len(JOINT_NAMES)

JOINT_INDEX: Final = {name: index for index, name in enumerate(JOINT_NAMES)}

ANCHOR_NAMES: Final = ("Head", "HandLeft", "HandRight", "FootLeft", "FootRight")
"""Names of the anchors, in the order used everywhere. An anchor is an extremum of the body's surface: a point that is
farther from the body's centre, along the skin, than all points around it. It is at or near the joint of this name.
"""

LIMBS: Final = tuple(
    (JOINT_INDEX[start], JOINT_INDEX[end])
    for start, end in (
        ("SpineBase", "SpineMid"),
        ("SpineMid", "SpineShoulder"),
        ("SpineShoulder", "Neck"),
        ("Neck", "Head"),
        ("SpineShoulder", "ShoulderLeft"),
        ("ShoulderLeft", "ElbowLeft"),
        ("ElbowLeft", "WristLeft"),
        ("WristLeft", "HandLeft"),
        ("SpineShoulder", "ShoulderRight"),
        ("ShoulderRight", "ElbowRight"),
        ("ElbowRight", "WristRight"),
        ("WristRight", "HandRight"),
        ("SpineBase", "HipLeft"),
        ("HipLeft", "KneeLeft"),
        ("KneeLeft", "AnkleLeft"),
        ("AnkleLeft", "FootLeft"),
        ("SpineBase", "HipRight"),
        ("HipRight", "KneeRight"),
        ("KneeRight", "AnkleRight"),
        ("AnkleRight", "FootRight"),
    )
)
"""Pairs of joint indices that a drawing connects by a line."""


class JointState(StrEnum):
    """The state of a joint in a frame: seen, hidden (and by what), outside of the image, or lost. The values are the
    texts in the tables of results.
    """

    OBSERVED = "observed"
    HIDDEN_BY_SELF = "hidden_by_self"
    HIDDEN_BY_EQUIPMENT = "hidden_by_equipment"
    HIDDEN_BY_PERSON = "hidden_by_person"
    HIDDEN = "hidden"
    OUT_OF_VIEW = "out_of_view"
    LOST = "lost"


STATE_CODE: Final = {state: code for code, state in enumerate(JointState)}
"""Code of each state in arrays, from 0 (observed) to 6 (lost). The less is known about a joint, the larger the code of
its state.
"""

STATE_NAMES: Final = tuple(str(state) for state in JointState)
"""Names of the states in the order of their codes."""

LOST: Final = STATE_CODE[JointState.LOST]
