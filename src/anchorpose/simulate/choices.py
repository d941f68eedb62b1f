"""Define the choices of a simulated recording, by names that are also values of options of ``anchorpose simulate``."""

from __future__ import annotations

from typing import Literal

Sensor = Literal[
    "kinect-v2",
    "azure-kinect",
    "realsense",
    "kinect-v1",
    "realsense-filtered",
    "azure-kinect-wfov",
    "femto-bolt",
    "d435",
    "xtion",
    "iphone-lidar",
]
LensName = Literal["pinhole", "brown-conrady", "rational", "kannala-brandt"]
Speed = Literal["slow", "normal", "fast", "mixed"]
Scene = Literal["enters-late", "leaves", "hidden", "sits"]
Equipment = Literal["none", "standing-frame", "parallel-bars", "walker", "wheelchair", "sling"]
When = Literal["off", "on", "both", "none"]
"""The trials of a session: without stimulation, with it, all, or none."""
Build = Literal["ordinary", "varied", "wasted-legs", "heavy", "child"]
"""ordinary: of the body asset. varied: every segment by itself. wasted-legs: the same, with thin legs under a strong
upper body, as after years of paralysis. heavy: the same with a belly, and more on all limbs. child: of 1.0 to
1.5 m, every segment by itself."""
BraceName = Literal["left shank", "right shank", "left thigh", "right thigh", "trunk"]
