"""Two results folders, the truth and a recording, for the tests of what verbs do with the paths that they are given."""

from pathlib import Path

import numpy as np
from recording_builder import write_recording
from results_builder import make_frame, standing_joints, write_results

from anchorpose.cli import main
from anchorpose.joints import JOINT_NAMES


def make_places(folder: Path, results: str = "results") -> dict[str, Path]:
    """results and later, which is another session; both are measured."""
    for name, height_m in ((results, 0.0), ("later", 0.2)):
        joints = standing_joints() + np.array([0.0, height_m, 0.0])
        write_results(folder / name, [make_frame(k, k / 15, joints) for k in range(40)])
        assert main(["measure", str(folder / name)]) == 0
    arrays = {"joints": np.repeat(standing_joints()[None], 40, 0), "names": np.array(JOINT_NAMES)}
    np.savez(folder / "truth.npz", **arrays, time=np.arange(40) / 15)
    write_recording(folder / "recording", frames=6)
    names = {"results": results, "later": "later", "recording": "recording", "truth": "truth.npz", "out": "out"}
    return {name: folder / file for name, file in names.items()}
