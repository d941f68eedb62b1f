"""Find 21 joints of a patient in depth recordings without markers, each joint with its state and uncertainty.

A program can call ``track`` on a recording, ``open`` its results, or pass single frames to a ``Tracker``
(docs/python.md). A public name of the package is imported when a program first uses the name; ``__init__.pyi`` declares
the types for type checkers.
"""

from importlib import import_module
from typing import Any, Final

__version__ = "1.0.0rc1"

_PLACES: Final = {  # the module of each public name
    "AnchorposeError": "errors",
    "Camera": "camera",
    "DepthImages": "api.arrays",
    "InputError": "errors",
    "Intrinsics": "lens",
    "JOINT_NAMES": "joints",
    "JointState": "joints",
    "Pose": "api.frame_by_frame",
    "Results": "api.results",
    "Subject": "recording.recording",
    "TrackConfig": "tracker.config",
    "Tracker": "api.frame_by_frame",
    "open": "api.track",
    "track": "api.track",
}

__all__ = [
    "JOINT_NAMES",
    "AnchorposeError",
    "Camera",
    "DepthImages",
    "InputError",
    "Intrinsics",
    "JointState",
    "Pose",
    "Results",
    "Subject",
    "TrackConfig",
    "Tracker",
    "open",
    "track",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), "open_results" if name == "open" else name)


def __dir__() -> list[str]:
    return sorted([*_PLACES, "__version__"])
