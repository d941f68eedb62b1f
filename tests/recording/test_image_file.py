"""Images that are not depth frames: a damaged one is None, and no library prints about it."""

import os

import cv2
import numpy as np
import pytest

from anchorpose.recording.regular_file import read_image

PIXELS = np.random.default_rng(3).integers(0, 256, (40, 50, 3), dtype=np.uint8)


@pytest.mark.parametrize("ending", [".png", ".jpg"])
@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "absent"])
def test_a_damaged_image_is_none_and_the_console_stays_silent(tmp_path, capfd, ending, damage):
    data = bytearray(cv2.imencode(ending, PIXELS)[1].tobytes())
    data[len(data) // 2] ^= 0xFF
    content = {"cut": bytes(data[: len(data) // 3]), "flipped": bytes(data), "empty": b"", "absent": None}[damage]
    path = tmp_path / f"picture{ending}"
    if content is not None:
        path.write_bytes(content)
    found = read_image(path)
    assert found is None or ending == ".jpg"  # a damaged JPEG may be decoded in part
    assert capfd.readouterr() == ("", "")


def test_a_whole_image_is_read_and_errors_are_shown_again(tmp_path, capfd):
    cv2.imwrite(str(tmp_path / "picture.png"), PIXELS)
    assert np.array_equal(read_image(tmp_path / "picture.png"), PIXELS)
    os.write(2, b"shown")
    assert capfd.readouterr().err == "shown"
