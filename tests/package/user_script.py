"""What a user of the package writes; mypy checks it against the installed wheel, whose types it needs (``.ci/run``)."""

from pathlib import Path

import numpy as np

import anchorpose


def head_height_m(recording: Path) -> float:
    """Track a recording and return the mean height of the head."""
    results = anchorpose.track(recording, config=anchorpose.TrackConfig(height_m=1.72))
    head = anchorpose.JOINT_NAMES.index("Head")
    return float(np.nanmean(results.joint_table.position_m[:, head, 1]))


def last_pose(images: dict[str, np.ndarray], cameras: list[anchorpose.Camera]) -> anchorpose.Pose | None:
    """Give one frame to a tracker."""
    with anchorpose.Tracker(cameras) as tracker:
        return tracker.step(images, 0.0)


def mistake() -> None:
    """A wrong type is found, which shows that types are known; without them mypy reports the comment as unused."""
    anchorpose.open(17)  # type: ignore[arg-type]
