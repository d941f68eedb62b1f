"""Choose the places on the patient's skin that a therapist's hands hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.body.kinematics import missing_joints
from anchorpose.joints import JOINT_INDEX
from anchorpose.rotations import UP, unit
from anchorpose.simulate.config import SimulationConfig, TaskName
from anchorpose.simulate.patient import Actor
from anchorpose.simulate.person import Person, skin_points
from anchorpose.simulate.posture import OUTWARD
from anchorpose.simulate.retarget import CapturedActor


@dataclass(frozen=True, slots=True)
class Task:
    """A therapist's task."""

    name: TaskName
    azimuth: tuple[float, float]  # rad, range of the direction from patient to therapist: 0 = front, positive = left
    holds: tuple[str, str]  # the patient's joints that the therapist's left and right hand hold


TASKS = (
    Task("both knees from the front", (-0.5, 0.5), ("KneeRight", "KneeLeft")),
    Task("left knee and hip", (1.1, 1.6), ("HipLeft", "KneeLeft")),
    Task("right knee and hip", (-1.6, -1.1), ("KneeRight", "HipRight")),
    Task("hips from behind", (2.7, 3.6), ("HipLeft", "HipRight")),
    Task("trunk from behind", (2.8, 3.5), ("SpineMid", "SpineMid")),
    Task("left knee from the front", (0.45, 0.9), ("KneeLeft", "KneeLeft")),
    Task("right knee from the front", (-0.9, -0.45), ("KneeRight", "KneeRight")),
)
HOLD_BONES = {
    "Knee": ("{side}UpLeg", "{side}Leg"),
    "Hip": ("{side}UpLeg", "{initial}HipJoint", "Hips"),
    "SpineMid": ("LowerBack", "Spine", "Spine1"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """A therapist's two hands on the patient's skin."""

    vertices: np.ndarray  # (2,) vertices of the skin that the hands hold
    joints: np.ndarray  # (2,) joints that the hands hold
    facing: np.ndarray  # (3,) direction of the fingers
    places_m: np.ndarray  # (2, 3) positions of the held vertices at the time for which the therapist's place is chosen

    @property
    def reference_m(self) -> np.ndarray:
        """Return the middle (3,) between the two held places."""
        return self.places_m.mean(axis=0)


def tasks_on(patient: Actor | CapturedActor, config: SimulationConfig) -> list[Task]:
    """Return the tasks whose joints the patient has; a joint on a missing limb cannot be held."""
    missing = missing_joints(patient.person.body.asset, config.body.missing)
    return [task for task in TASKS if not missing[[JOINT_INDEX[name] for name in task.holds]].any()]


def nearest_s(patient: CapturedActor, task: Task, outward: np.ndarray, times_s: np.ndarray) -> float:
    """Return the time at which the joints that the therapist holds are farthest in the direction ``outward``, and so
    nearest to the therapist.

    A therapist's place that has enough space at this time has enough space at all times, since these joints never come
    nearer.
    """
    joints_m = np.array([patient.person.body.joints(bones) for bones in patient.bones(times_s)])
    held = joints_m[:, [JOINT_INDEX[name] for name in task.holds]].mean(axis=1)
    return float(times_s[np.argmax(held @ outward)])


def choose_hold(patient: Actor | CapturedActor, task: Task, facing: np.ndarray, at_s: float) -> Hold:
    """Choose a vertex of skin near each joint to hold, on the side towards the therapist, in the pose at ``at_s``."""
    person = patient.person
    bones = patient.bones(np.array([at_s]))
    everything = np.arange(len(person.normals))
    skin = skin_points(person, bones, everything)[0][0]
    joints_m = person.body.joints(bones[0])
    right = np.cross(facing, UP)
    vertices = []
    for hand, name in enumerate(task.holds):
        inner = 0.25 if task.holds[0] != task.holds[1] else 1.0
        wanted = unit(-facing + inner * OUTWARD[hand] * right)
        vertices.append(_skin_towards(person, skin, joints_m[JOINT_INDEX[name]], name, wanted))
    index = np.array(vertices)
    joints = np.array([JOINT_INDEX[name] for name in task.holds])
    return Hold(index, joints, facing, skin[index])


def _skin_towards(person: Person, skin_m: np.ndarray, joint_m: np.ndarray, name: str, wanted: np.ndarray) -> int:
    """Return the vertex to hold: a vertex that is far from a joint in the direction ``wanted``, but near the line from
    the joint in this direction. Raises ValueError if the body has no skin around the joint.
    """
    asset = person.body.asset
    side = "Left" if name.endswith("Left") else "Right"
    patterns = next(bones for key, bones in HOLD_BONES.items() if name.startswith(key))
    allowed = [asset.bone(pattern.format(side=side, initial=side[0])) for pattern in patterns]
    offset = skin_m - joint_m
    along = offset @ wanted
    aside = np.linalg.norm(offset - along[:, None] * wanted, axis=1)
    usable = np.isin(asset.main_bone(), allowed) & (np.linalg.norm(offset, axis=1) < 0.3)
    if not usable.any():
        raise ValueError(f"the body has no skin that a hand at {name} could hold")
    return int(np.argmax(np.where(usable, along - 2.0 * aside, -np.inf)))
