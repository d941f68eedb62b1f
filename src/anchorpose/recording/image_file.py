"""Reading images that are not depth frames: photographs of markers, pictures of results, labels."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Final

import cv2
import numpy as np

from anchorpose.recording.regular_file import LARGEST_IMAGE, Unreadable, read_bounded

_ERROR_STREAM: Final = 2
_REDIRECTED: Final = Lock()


def read_image(path: Path, flags: int = cv2.IMREAD_UNCHANGED) -> np.ndarray | None:
    """Return the pixels of an image file as OpenCV does, None where it cannot be read or is damaged."""
    try:
        data = read_bounded(path, LARGEST_IMAGE)
        with _silent_decoders():
            return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except (Unreadable, cv2.error):  # the second: no bytes, or more pixels than it decodes
        return None


@contextmanager
def _silent_decoders() -> Iterator[None]:
    """Discard what libpng and libjpeg print about damaged files: no log level of OpenCV reaches them.

    The error stream of the whole process is redirected, so this is not for images that are read while others work.
    """
    with _REDIRECTED, open(os.devnull, "wb") as nothing:
        kept = os.dup(_ERROR_STREAM)
        os.dup2(nothing.fileno(), _ERROR_STREAM)
        try:
            yield
        finally:
            os.dup2(kept, _ERROR_STREAM)
            os.close(kept)
