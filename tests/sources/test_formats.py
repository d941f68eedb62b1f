"""Each format, written by hand or by another library: the same pixels, times to the microsecond, the lens in place."""

from datetime import datetime, timedelta

import numpy as np
import pytest
import sources_builder as build
from sources_builder import (
    FORMATS,
    FRAMES,
    GIVEN,
    HEIGHT,
    LENS,
    WIDTH,
    depth_of,
    expected,
    noise,
    peak_bytes,
    run,
    times_of,
)

from anchorpose.errors import InputError
from anchorpose.options import ConvertOptions
from anchorpose.recording.depth_image import FARTHEST_M
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.sources.grey_images import GREY_M
from anchorpose.sources.source import open_source

THIRTIETHS = [round(k / 30, 6) for k in range(FRAMES)]

TIMES = {
    "tum": [round(1305031102.160407 + k / 30, 6) for k in range(FRAMES)],
    "open3d": [round(k / 15, 6) for k in range(FRAMES)],
    "redwood": [round(33369e-6 * k, 6) for k in range(FRAMES)],
    "stray": [round(5.000001 + k / 60, 6) for k in range(FRAMES)],
}
SCALES = {"open3d": 1 / 4000, "tum": 1 / 5000, "icl": 1 / 5000}

NEEDS = {
    "plain_folder": GIVEN,
    "pgm_folder": GIVEN,
    "npy": GIVEN,
    "mat": GIVEN,
    "tum": ConvertOptions(intrinsics=LENS),
    "icl": ConvertOptions(intrinsics=LENS, fps=30.0),
    "redwood": ConvertOptions(intrinsics=LENS, depth_scale=0.001),
    "scannet": ConvertOptions(fps=30.0),
}
"""What each format does not say."""


@pytest.mark.parametrize("name", FORMATS)
def test_depth_times_and_lens_arrive_unchanged(tmp_path, name):
    grey = noise()
    FORMATS[name](tmp_path / name, grey)
    done = run(tmp_path / name, tmp_path / "out", NEEDS.get(name))
    assert done.cameras == ((name, FRAMES),)
    assert np.array_equal(depth_of(tmp_path / "out", name), expected(grey))
    assert times_of(tmp_path / "out", name) == TIMES.get(name, THIRTIETHS)
    recording = open_recording(tmp_path / "out")
    (camera,) = recording.cameras
    assert camera.depth_scale == pytest.approx(SCALES.get(name, 0.001))
    if name != "stray":
        lens = camera.intrinsics
        assert (lens.fx, lens.fy, lens.cx, lens.cy) == LENS
    depths = [frame.depths_m[0] for frame in read_frames(recording)]
    metres = expected(grey) * np.float32(camera.depth_scale)
    assert np.allclose(depths, np.where(metres > FARTHEST_M, 0.0, metres), rtol=1e-6)


@pytest.mark.parametrize("name", NEEDS)
def test_what_a_format_does_not_say_is_asked_for_in_one_sentence(tmp_path, name):
    FORMATS[name](tmp_path / name, noise())
    with pytest.raises(InputError) as refused:
        run(tmp_path / name, tmp_path / "out")
    given = NEEDS[name]
    wanted = {"--intrinsics": given.intrinsics, "--depth-scale": given.depth_scale, "--fps": given.fps}
    assert [option for option in wanted if option in str(refused.value)] == [
        option for option, value in wanted.items() if value is not None
    ]
    assert not (tmp_path / "out").exists()


def test_a_stray_scanner_lens_is_scaled_about_the_corner_of_the_image(tmp_path):
    build.stray(tmp_path / "s", noise())
    run(tmp_path / "s", tmp_path / "out")
    (camera,) = open_recording(tmp_path / "out").cameras
    lens, scale = camera.intrinsics, WIDTH / 1920
    assert (lens.fx, lens.fy) == pytest.approx((1600 * scale, 1601 * scale))
    assert (lens.cx, lens.cy) == pytest.approx((961 * scale - 0.5, 720 * scale - 0.5))


def test_a_camera_that_was_carried_is_named(tmp_path):
    build.stray(tmp_path / "s", noise())
    assert not any("moved" in note for note in run(tmp_path / "s", tmp_path / "out").notes)
    odometry = tmp_path / "s" / "odometry.csv"
    odometry.write_text(odometry.read_text().replace("000000, 0.1,", "000000, 0.4,"))
    assert any("moved by 0.30 m" in note for note in run(tmp_path / "s", tmp_path / "o2").notes)
    build.scannet(tmp_path / "t", noise())
    notes = run(tmp_path / "t", tmp_path / "o3", NEEDS["scannet"]).notes
    assert any("moved by 0.30 m" in note for note in notes)


@pytest.mark.parametrize("name", ["npy", "mat"])
def test_metres_become_steps_of_a_quarter_millimetre(tmp_path, name):
    depth_m = np.random.default_rng(1).uniform(0.3, 16.0, (3, HEIGHT, WIDTH)).astype(np.float32)
    depth_m[:, 0], depth_m[:, 1], depth_m[:, 2], depth_m[:, 3] = np.nan, 0.0, np.inf, 20.0
    FORMATS[name](tmp_path / "a", depth_m) if name == "mat" else np.save(tmp_path / "a.npy", depth_m)
    source = tmp_path / ("a" if name == "mat" else "a.npy")
    run(source, tmp_path / "out", ConvertOptions(intrinsics=LENS, fps=30.0))
    (camera,) = open_recording(tmp_path / "out").cameras
    back_m = depth_of(tmp_path / "out", "a") * camera.depth_scale
    assert not back_m[:, :4].any()
    assert np.abs(back_m[:, 4:] - depth_m[:, 4:]).max() <= 0.000126


def test_an_array_in_unknown_units_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.full((2, HEIGHT, WIDTH), 2300.0))
    with pytest.raises(InputError, match="no distance in metres"):
        open_source(tmp_path / "a.npy")


def test_a_record3d_file(tmp_path):
    pytest.importorskip("lzfse")
    depth_m = np.random.default_rng(1).uniform(0.3, 4.0, (4, 32, 24)).astype(np.float32)
    depth_m[:, 0] = np.nan
    build.r3d(tmp_path / "walk.r3d", depth_m)
    done = run(tmp_path / "walk.r3d", tmp_path / "out")
    assert any("moved" in note for note in done.notes)
    (camera,) = open_recording(tmp_path / "out").cameras
    lens = camera.intrinsics
    assert (lens.fx, lens.fy, lens.cx, lens.cy) == pytest.approx((1000 / 30, 1001 / 30, 11.5, 15.5))
    back_m = depth_of(tmp_path / "out", "walk") * camera.depth_scale
    assert np.abs(back_m - np.nan_to_num(depth_m)).max() <= 0.000126
    assert times_of(tmp_path / "out", "walk") == [round(100.000001 + k / 60, 6) for k in range(4)]


def test_a_record3d_file_that_states_gigabytes_costs_no_memory(tmp_path):
    """A stored file's compressed size, which zipfile believes when it asks for memory."""
    pytest.importorskip("lzfse")
    build.r3d(tmp_path / "in", np.full((2, 16, 12), 1.5, np.float32))
    data = bytearray((tmp_path / "in").read_bytes())
    entry = data.rindex(b"PK\x01\x02")
    data[entry + 20 : entry + 24] = (3 << 30).to_bytes(4, "little")
    (tmp_path / "in").write_bytes(data)
    notes = list[str]()
    assert peak_bytes(lambda: notes.extend(run(tmp_path / "in", tmp_path / "out").notes)) < 50_000_000
    assert any("1.depth, is damaged inside" in note for note in notes)


def test_an_array_that_states_gigabytes_costs_no_memory(tmp_path):
    with (tmp_path / "in").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"shape": (1, 16384, 16384), "fortran_order": False, "descr": "<f8"})
        file.write(bytes(1000))

    def refused():
        with pytest.raises(InputError, match="ends within image 0"):
            run(tmp_path / "in", tmp_path / "out", GIVEN)

    assert peak_bytes(refused) < 50_000_000


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", ["<u2", "<f4", "<f8", ">u2"])
def test_an_array_of_matlab_s_beside_others(tmp_path, compressed, kind):
    """Written by scipy: another name, another number of dimensions, text and a cell stand beside it."""
    import scipy.io

    grey = noise(4)
    depth = np.moveaxis(grey if kind.endswith("u2") else grey * GREY_M, 0, 2).astype(kind)
    others = {"flat": np.eye(3), "text": "depth", "cells": np.array([1, "a"], object), "other": depth + 1, "empty": []}
    with (tmp_path / "in").open("wb") as file:
        scipy.io.savemat(file, {**others, "my_depth": depth}, do_compression=compressed)
    given = GIVEN if kind.endswith("u2") else ConvertOptions(intrinsics=LENS, fps=30.0)
    run(tmp_path / "in", tmp_path / "out", given)
    assert np.array_equal(depth_of(tmp_path / "out", "in"), expected(grey))


def test_missing_numbers_are_missing_moments(tmp_path):
    grey = noise()
    build.plain_folder(tmp_path / "p", grey)
    (tmp_path / "p" / "depth_3.png").unlink()
    run(tmp_path / "p", tmp_path / "out", GIVEN)
    assert times_of(tmp_path / "out", "p") == [*THIRTIETHS[:3], *THIRTIETHS[4:]]
    assert np.array_equal(depth_of(tmp_path / "out", "p"), expected(np.delete(grey, 3, axis=0)))


@pytest.mark.parametrize("begin_s", [58.0, 20.0])
def test_dates_and_clock_times_in_names_are_never_taken_for_microseconds(tmp_path, begin_s):
    """Such names would jump by 40 s at a full minute. Within a minute they give the times."""
    grey, begin = noise(90), datetime.fromisoformat("2026-03-28T10:30:00")
    true_s = [begin_s + round(k / 30, 6) for k in range(len(grey))]
    for second, image in zip(true_s, grey, strict=True):
        name = (begin + timedelta(seconds=second)).strftime("%Y%m%d-%H%M%S%f")
        build.write_png(tmp_path / "p" / f"{name}.png", image)
    if begin_s == 58.0:
        with pytest.raises(InputError, match=r"does not state.*times.*--fps"):
            run(tmp_path / "p", tmp_path / "out", ConvertOptions(intrinsics=LENS, depth_scale=0.001))
        run(tmp_path / "p", tmp_path / "out", GIVEN)
    else:
        run(tmp_path / "p", tmp_path / "out", ConvertOptions(intrinsics=LENS, depth_scale=0.001))
    found_s = np.array(times_of(tmp_path / "out", "p"))
    assert found_s - found_s[0] == pytest.approx(np.array(true_s) - begin_s, abs=2e-6)


def test_microseconds_in_names_may_be_missing_and_uneven(tmp_path):
    chance = np.random.default_rng(0)
    micros = np.cumsum(chance.integers(30_000, 37_000, 2500))[::7].tolist()  # more than a minute
    grey = noise(len(micros))
    for k, (micro, image) in enumerate(zip(micros, grey, strict=True)):
        build.write_png(tmp_path / "p" / f"{k:07d}-{micro:012d}.png", image)
    run(tmp_path / "p", tmp_path / "out", ConvertOptions(intrinsics=LENS, depth_scale=0.001))
    assert times_of(tmp_path / "out", "p") == [micro / 1e6 for micro in micros]


@pytest.mark.parametrize("numbers", [[round(k * 1000 / 30) for k in range(7)], range(0, 14, 2)])
def test_numbers_that_do_not_count_the_images_give_no_times(tmp_path, numbers):
    """Milliseconds, for example: at 30 per second, one second of images would last half a minute."""
    build.plain_folder(tmp_path / "p", noise(7))
    for place, number in reversed(list(enumerate(numbers))):
        (tmp_path / "p" / f"depth_{place}.png").rename(tmp_path / "p" / f"depth_{number}.png")
    with pytest.raises(InputError, match=f"differ by {numbers[-1] // 6}, .*times_s"):
        run(tmp_path / "p", tmp_path / "out", GIVEN)
    assert not (tmp_path / "out").exists()
    build.sidecar(tmp_path / "p" / "depth.json")
    with pytest.raises(InputError, match=r"differ by .*times_s"):
        run(tmp_path / "p", tmp_path / "out")
    build.sidecar(tmp_path / "p" / "depth.json", times_s=THIRTIETHS)
    run(tmp_path / "p", tmp_path / "out")
    assert times_of(tmp_path / "out", "p") == THIRTIETHS


def test_images_are_in_the_order_of_their_numbers_and_colour_is_left_alone(tmp_path):
    grey = noise(12)
    build.plain_folder(tmp_path / "p", grey)
    build.write_png(tmp_path / "p" / "color_1.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    done = run(tmp_path / "p", tmp_path / "out", GIVEN)
    assert np.array_equal(depth_of(tmp_path / "out", "p"), expected(grey))
    assert any("not 16-bit grey" in note for note in done.notes)


def test_a_damaged_image_is_left_out_and_named(tmp_path):
    grey = noise()
    build.tum(tmp_path / "t", grey)
    damaged = sorted((tmp_path / "t" / "depth").iterdir())[2]
    damaged.write_bytes(damaged.read_bytes()[:-30])
    done = run(tmp_path / "t", tmp_path / "out", NEEDS["tum"])
    assert any(damaged.name in note and "truncated" in note for note in done.notes)
    assert np.array_equal(depth_of(tmp_path / "out", "t"), expected(np.delete(grey, 2, axis=0)))


@pytest.mark.parametrize(
    ("name", "head", "says"),
    [
        ("a.bin", b"EVENTS1\0\5\0\0\0", "Kinect Studio"),
        ("a.bin", b"NI10\0\0", "OpenNI"),
        ("a.mcap", b"\x89MCAP0\r\n\x01\x1a" + bytes(12) + b"libmcap stereolabs", "ZED"),
        ("a.svo", b"anything", "ZED"),
        ("a.bin", b"MATLAB 7.3 MAT-file", "-v7"),
    ],
)
def test_formats_that_cannot_be_read_are_refused_with_the_way_round(tmp_path, name, head, says):
    (tmp_path / name).write_bytes(head)
    with pytest.raises(InputError, match=says):
        open_source(tmp_path / name)


def test_a_sidecar_that_does_not_fit_is_refused(tmp_path):
    build.raw_folder(tmp_path / "r", noise())
    build.sidecar(tmp_path / "r" / "depth.json", times_s=[0.0, 0.1])
    with pytest.raises(InputError, match="2 times for 7"):
        open_source(tmp_path / "r")
    build.plain_folder(tmp_path / "p", noise())
    build.sidecar(tmp_path / "p" / "depth.json", width=WIDTH + 1)
    with pytest.raises(InputError, match="width is 33"):
        open_source(tmp_path / "p")
