"""The library without the tracker: one depth picture, its surface, geodesic distances on it, and the anchors.

python examples/geodesics_of_one_picture.py RECORDING [--frame 0]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from anchorpose.geodesics.anchors import find_anchors
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.recording.reader import open_recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.inspection import inspect_frame


def main() -> None:
    """Prints how far each anchor is from the head along the skin and through the air."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--frame", type=int, default=0)
    given = parser.parse_args()

    # isolation and surface as the tracker makes them of a single frame
    inspection = inspect_frame(open_recording(given.recording), given.frame, TrackConfig(), False, lambda: None)
    if inspection.observation is None:
        raise SystemExit(" ".join(inspection.account))
    surface = inspection.observation.surface
    anchors = find_anchors(surface, up=np.array([0.0, 1.0, 0.0]), facing=np.array([1.0, 0.0, 0.0]))
    print(f"{len(surface)} nodes; anchors found: {int(anchors.found.sum())} of {len(ANCHOR_NAMES)}")
    if not anchors.found[0]:
        return
    along_skin_m = geodesic_distance(surface, anchors.node[:1])[0]
    for name, node in zip(ANCHOR_NAMES[1:], anchors.node[1:], strict=True):
        if node >= 0:
            straight_m = np.linalg.norm(surface.points_m[node] - surface.points_m[anchors.node[0]])
            print(f"head to {name}: {along_skin_m[node]:.2f} m along the skin, {straight_m:.2f} m through the air")


if __name__ == "__main__":
    main()
