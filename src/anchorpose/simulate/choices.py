"""Define the named choices of a simulated recording. The names are also values of ``anchorpose simulate``'s options."""

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
"""Kind of the patient's body. ordinary: drawn from the body asset's shape space. varied: the size of every segment is
drawn separately. All other kinds are varied, too: wasted-legs has thin legs and strong arms, as after years of
paralysis; heavy has a belly and thicker limbs; child is 1.0 to 1.5 m tall."""
BraceName = Literal["left shank", "right shank", "left thigh", "right thigh", "trunk"]
