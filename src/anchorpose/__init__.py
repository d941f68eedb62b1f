"""Find 21 joints of a patient in recordings of depth cameras, without markers on the body. Each joint has a state and
an uncertainty.

A program can call ``track`` on a recording, ``open`` its results, or pass single frames to a ``Tracker``
(docs/python.md). A public name of the package is imported when a program first uses the name; ``__init__.pyi`` declares
the types for type checkers.
"""

import os
import sys
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


def _is_writable(folder: str) -> bool:
    """Return whether files can be written in a folder or, if the folder is missing, whether the folder can be made."""
    folder = os.path.abspath(folder)
    while not os.path.exists(folder) and folder != os.path.dirname(folder):
        folder = os.path.dirname(folder)
    return os.access(folder, os.W_OK | os.X_OK)


def _choose_kernel_cache() -> None:
    """Set NUMBA_CACHE_DIR to a folder for numba's compiled functions (kernels) if this variable is not set and numba
    can write neither beside the modules nor in the user's cache folder, as in a container. Without such a folder, no
    kernel could be imported.
    """
    user_cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if os.environ.get("NUMBA_CACHE_DIR") or _is_writable(os.path.dirname(__file__)) or _is_writable(user_cache):
        return
    try:
        os.environ["NUMBA_CACHE_DIR"] = _make_kernel_cache()
    except OSError:  # no folder at all can be written; numba reports this when a kernel is imported
        return


def _make_kernel_cache() -> str:
    """Make a folder among the temporary files and return its path. Only this user can write to the folder, since a
    program that loads a kernel runs the kernel's code. The path stays the same from run to run unless another user has
    made a folder of this name.
    """
    import tempfile

    user = os.getuid() if sys.platform != "win32" else 0  # temporary files are the user's own on Windows
    folder = os.path.join(tempfile.gettempdir(), f"anchorpose-kernels-{user}")
    try:
        os.mkdir(folder, 0o700)
    except FileExistsError:
        found = os.lstat(folder)
        if sys.platform != "win32" and (found.st_mode, found.st_uid) != (0o040700, user):
            return tempfile.mkdtemp(prefix="anchorpose-kernels-")
    return folder


_choose_kernel_cache()


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), "open_results" if name == "open" else name)


def __dir__() -> list[str]:
    return sorted([*_PLACES, "__version__"])
