"""Chunks that an image does not need change none of its pixels, and unknown ones that it needs are refused."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from anchorpose.recording.depth_image import decode_grey_png, image_chunks

GREY = np.random.default_rng(5).integers(0, 65536, (48, 64)).astype(np.uint16)
PNG = cv2.imencode(".png", GREY)[1].tobytes()
HEADER = 33


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def animated() -> bytes:
    """Its first frame covers a corner of the image, as a valid animation may."""
    control = struct.pack(">IIIIIHHBB", 0, 16, 12, 0, 0, 1, 10, 0, 0)
    return PNG[:HEADER] + chunk(b"acTL", struct.pack(">II", 1, 0)) + chunk(b"fcTL", control) + PNG[HEADER:]


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(animated(), id="an animation"),
        pytest.param(PNG[:HEADER] + chunk(b"tEXt", b"Comment\0front") + PNG[HEADER:], id="a note"),
        pytest.param(PNG[:HEADER] + chunk(b"tRNS", b"\x07\xd0") + PNG[HEADER:], id="a transparent value"),
        pytest.param(PNG[:HEADER] + chunk(b"gAMA", struct.pack(">I", 45455)) + PNG[HEADER:], id="a gamma"),
        pytest.param(PNG[:HEADER] + chunk(b"zTXt", b"x\0\0" + zlib.compress(bytes(1 << 24))) + PNG[HEADER:], id="bomb"),
        pytest.param(PNG + b"what follows the image", id="bytes behind it"),
    ],
)
def test_what_is_beside_the_image_changes_no_pixel(data):
    grey, problem = decode_grey_png(data, 64, 48)
    assert problem == ""
    np.testing.assert_array_equal(grey, GREY)


def test_a_chunk_that_is_needed_and_unknown_is_a_problem():
    data = PNG[:HEADER] + chunk(b"NEED", b"1") + PNG[HEADER:]
    assert decode_grey_png(data, 64, 48)[0] is None
    assert "needs a chunk 'NEED'" in decode_grey_png(data, 64, 48)[1]


def test_a_bomb_fills_no_more_than_the_image():
    header = struct.pack(">IIBBBBB", 64, 48, 16, 0, 0, 0, 0)
    content = zlib.compress(bytes(1 << 26), 9)
    data = PNG[:8] + chunk(b"IHDR", header) + chunk(b"IDAT", content) + chunk(b"IEND", b"")
    grey, problem = decode_grey_png(data, 64, 48)
    assert (grey is None and problem) or grey.shape == (48, 64)


def test_an_ordinary_file_reaches_the_decoder_as_it_is():
    assert image_chunks(PNG) == (PNG, "")
