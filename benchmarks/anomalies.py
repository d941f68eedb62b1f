"""Draw known anomalies of tracking, each in a frame that shows it: python benchmarks/anomalies.py OUT.png

The result is white; the truth or, on real depth, the labels by eye are green. Results that ``run.py`` has kept are
used; recordings without kept results are tracked now.
"""

from __future__ import annotations

import sys
from itertools import chain
from pathlib import Path
from typing import Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from run import CACHE, results_folder, tracked
from scores import LABELS
from suites import hard, real
from versions import working_tree

from anchorpose.camera import invert_rigid, transform_points
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.research.benchmark.labels import LABELLERS, read_labels
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import JOINTS_FILE, read_joints


class Anomaly(NamedTuple):
    """An anomaly. recording: its recording's name in the suites; frame: number of the frame to draw; title: fault."""

    recording: str
    frame: int
    title: str


ANOMALIES: Final = (
    Anomaly("hard-parallel-bars-sit-to-stand-41019-10-front", 118, "A hidden leg is placed wrong"),
    Anomaly("hard-parallel-bars-sit-to-stand-41007-10-front", 60, "A seated pelvis is too high"),
    Anomaly("iit_rehab_room", 180, "Filters smear the depth image"),
)
CHAINS: Final = (
    ("Head", "Neck", "SpineShoulder", "SpineMid", "SpineBase"),
    *(
        (middle, *(f"{name}{side}" for name in limb))
        for middle, limb in (
            ("SpineShoulder", ("Shoulder", "Elbow", "Wrist", "Hand")),
            ("SpineBase", ("Hip", "Knee", "Ankle", "Foot")),
        )
        for side in ("Left", "Right")
    ),
)
FARTHEST_M: Final = 4.5  # depth that is drawn black
MARGIN_PX: Final = 40  # around the patient


def draw(axes: Axes, anomaly: Anomaly) -> None:
    """Draw the depth image with the result, and with the truth or the labels."""
    cases = chain(hard("tuning", False), real("tuning", False))
    case = next(one for one in cases if one.recording.name == anomaly.recording)
    ready = case.recording.ready(CACHE)
    named = None if ready is None else case.name(ready)
    if ready is None or named is None:
        raise SystemExit(f"{anomaly.recording} is not here")
    results = results_folder(ready, named, working_tree(), CACHE)
    tracked(results, ready, named, working_tree())
    recording, table = open_recording(ready.recording), read_joints(results / JOINTS_FILE)
    row = int(np.flatnonzero(table.frame == anomaly.frame)[0])
    T_camera_world = invert_rigid(np.array(read_run(results / RUN_FILE)["cameras"][0]["camera_to_world"]))
    camera, depth_m = recording.cameras[0], read_frame(recording, row).depths_m[0]
    found = camera.project(transform_points(T_camera_world, table.position_m[row]))
    axes.imshow(np.where(depth_m > 0, depth_m, FARTHEST_M), cmap="gray_r", vmin=1.0, vmax=FARTHEST_M)
    if ready.truth is None:
        shown = np.concatenate([_labelled(anomaly, labeller) for labeller in LABELLERS])
        axes.plot(*shown.T, ".", color="lime", markersize=3)
    else:
        shown = camera.project(transform_points(T_camera_world, np.load(ready.truth)["joints"][anomaly.frame]))
        _draw_skeleton(axes, shown, "lime")
    _draw_skeleton(axes, found, "white")
    low, high = np.nanmin(shown, axis=0) - MARGIN_PX, np.nanmax(shown, axis=0) + MARGIN_PX
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]))
    axes.set_title(anomaly.title, fontsize=9)
    axes.axis("off")


def _labelled(anomaly: Anomaly, labeller: str) -> np.ndarray:
    """Return the labels (n, 2), column and row, of one labeller."""
    people = read_labels(LABELS, anomaly.recording, labeller)[anomaly.frame]
    return np.array([place for one in people for place in one.joints.values()])


def _draw_skeleton(axes: Axes, place: np.ndarray, colour: str) -> None:
    for chain_of in CHAINS:
        axes.plot(*place[[JOINT_INDEX[name] for name in chain_of]].T, color=colour, linewidth=1.2)


def main() -> None:
    """Write the picture."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, every = plt.subplots(1, len(ANOMALIES), figsize=(9.0, 3.6), layout="constrained")
    for axes, anomaly in zip(every, ANOMALIES, strict=True):
        draw(axes, anomaly)
    figure.savefig(Path(sys.argv[1]), dpi=110)


if __name__ == "__main__":
    main()
