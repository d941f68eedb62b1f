"""What a results folder amounts to, in a few lines."""

from __future__ import annotations

from pathlib import Path


def print_outcome(results: Path) -> None:
    """Prints how much was seen, inferred and lost, what was dropped, and where the report is."""
    import numpy as np

    from anchorpose.report.page import REPORT_FILE
    from anchorpose.results.joint_frame import LOST
    from anchorpose.results.run_record import RUN_FILE, read_run_document
    from anchorpose.results.tables import JOINTS_FILE, read_joints

    joints = read_joints(results / JOINTS_FILE)
    seen, lost = np.mean(joints.severity == 0), np.mean(joints.severity == LOST)
    print(
        f"{len(joints.frame)} frames: {100 * seen:.1f} % of the joints seen, {100 * (1 - seen - lost):.1f} % inferred, "
        f"{100 * lost:.1f} % lost."
    )
    dropped = read_run_document(results / RUN_FILE).get("dropped", [])
    if dropped:
        count, first = len({drop["frame"] for drop in dropped}), dropped[0]
        print(f"Frames with problems: {count}; the first is frame {first['frame']}: {first['why']}.")
    print(f"Results are in {results}; open {results / REPORT_FILE} in a browser.")
