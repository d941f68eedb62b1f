"""Which frames get a picture: spread, the surest, the least sure, transitions; the same ones each time."""

import numpy as np
from results_builder import make_frame, standing_joints, write_results

from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.pages.overlay import choose_frames
from anchorpose.results.records import SIT_TO_STAND, UPRIGHT_EPISODE, Episode
from anchorpose.results.tables import JointTable, read_joints

ALL = np.ones(50, bool)


def table(tmp_path, **different) -> JointTable:
    """Fifty frames of ten a second, some of them made differently."""
    frames = [
        make_frame(k, k / 10, standing_joints(), **({"sigma_m": 0.02} | different.get(f"frame_{k}", {})))
        for k in range(50)
    ]
    return read_joints(write_results(tmp_path / "r", frames) / "joints.parquet")


def episode(kind: str, start_s: float, end_s: float) -> Episode:
    first, last = round(10 * start_s), round(10 * end_s)
    return Episode(
        kind=kind, first_frame=first, last_frame=last, start_s=start_s, end_s=end_s, state=JointState.OBSERVED
    )


def test_surest_least_sure_and_transitions_are_among_them(tmp_path):
    joints = table(
        tmp_path, frame_7={"sigma_m": 0.01}, frame_31={"states": {"KneeLeft": JointState.HIDDEN}}, frame_33={}
    )
    episodes = [episode(UPRIGHT_EPISODE, 0.0, 2.0), episode(SIT_TO_STAND, 2.0, 2.6)]
    chosen = choose_frames(joints, episodes, ALL)
    spread = dict.fromkeys((0, 16, 32, 49), "")
    assert chosen == spread | {7: "surest of all frames", 23: "standing up", 31: "least sure of all frames"}


def test_a_lost_joint_is_worse_than_hidden_ones_and_a_lost_patient_is_no_picture(tmp_path):
    joints = table(
        tmp_path,
        frame_5={"states": dict.fromkeys(JOINT_NAMES[:9], JointState.HIDDEN)},
        frame_9={"lost": ("HandLeft",)},
        frame_20={"lost": JOINT_NAMES},
    )
    why = {why: row for row, why in choose_frames(joints, [], ALL).items()}
    assert why["least sure of all frames"] == 9


def test_a_patient_who_is_never_found_has_spread_frames_only(tmp_path):
    joints = table(tmp_path, **{f"frame_{k}": {"lost": JOINT_NAMES} for k in range(50)})
    assert choose_frames(joints, [], ALL) == dict.fromkeys(np.linspace(0, 49, 4).astype(int).tolist(), "")
