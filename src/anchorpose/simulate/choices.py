"""Define the choices of a simulated recording; the names are also values of options of ``anchorpose simulate``."""

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
"""Selection of a session's trials: off = without stimulation, on = with stimulation, both = all, none = no trial."""
Build = Literal["ordinary", "varied", "wasted-legs", "heavy", "child"]
"""ordinary: drawn from the body asset. varied: the size of every segment is drawn separately. wasted-legs: as varied,
with thin legs and a strong upper body, as after years of paralysis. heavy: as varied, with a belly and thicker limbs.
child: as varied, 1.0 to 1.5 m tall."""
BraceName = Literal["left shank", "right shank", "left thigh", "right thigh", "trunk"]
