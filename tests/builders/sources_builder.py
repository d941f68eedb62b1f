"""Recorders' folders and files, written by hand as their formats' pages describe them, from depth that is known."""

import json
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from anchorpose.options import ConvertOptions
from anchorpose.sources.convert import Converted, convert

WIDTH, HEIGHT, FRAMES = 32, 24, 7

LENS = (30.0, 31.0, 15.5, 11.5)
GIVEN = ConvertOptions(intrinsics=LENS, depth_scale=0.001, fps=30.0)


def noise(frames: int = FRAMES, width: int = WIDTH, height: int = HEIGHT, seed: int = 0) -> np.ndarray:
    """(frames, height, width) uint16 with every kind of value: near, far, 0 and 65535."""
    grey = np.random.default_rng(seed).integers(300, 65535, (frames, height, width)).astype(np.uint16)
    grey[:, 0, :5], grey[:, 1, :5] = 0, 65535
    return grey


def expected(grey: np.ndarray) -> np.ndarray:
    return np.where(grey == 65535, 0, grey)


def write_png(path: Path, grey: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(grey).save(path)


def read_png(path: Path) -> np.ndarray:
    """By Pillow: another decoder than the program's."""
    with Image.open(path) as image:
        return np.asarray(image).astype(np.uint16)


def nothing(done: int, total: int | None) -> None:
    pass


def run(inputs: Path | list[Path], out: Path, options: ConvertOptions | None = None) -> Converted:
    return convert(inputs if isinstance(inputs, list) else [inputs], out, options or ConvertOptions(), nothing)


def depth_of(recording: Path, name: str) -> np.ndarray:
    return np.stack([read_png(file) for file in sorted((recording / name / "depth").glob("*.png"))])


def times_of(recording: Path, name: str) -> list[float]:
    rows = (recording / name / "timestamps.csv").read_text().splitlines()[1:]
    return [float(row.split(",")[1]) for row in rows]


def content(folder: Path) -> dict[str, bytes]:
    files = [file for file in sorted(folder.rglob("*")) if file.is_file()]
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def peak_bytes(call: Callable[[], object]) -> int:
    """The most memory that Python asked for during a call."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def plain_folder(path: Path, grey: np.ndarray) -> None:
    for k, image in enumerate(grey):
        write_png(path / f"depth_{k}.png", image)


def pgm_folder(path: Path, grey: np.ndarray) -> None:
    path.mkdir(parents=True)
    for k, image in enumerate(grey):
        head = f"P5\n# a comment\n{image.shape[1]} {image.shape[0]}\n65535\n".encode()
        (path / f"{k:03d}.pgm").write_bytes(head + image.astype(">u2").tobytes())


def tum(path: Path, grey: np.ndarray) -> None:
    lines = ["# depth maps", "# timestamp filename"]
    for k, image in enumerate(grey):
        stamp = f"{1305031102.160407 + k / 30:.6f}"
        write_png(path / "depth" / f"{stamp}.png", image)
        lines.append(f"{stamp} depth/{stamp}.png")
    (path / "depth.txt").write_text("\n".join(lines) + "\n")


def icl(path: Path, grey: np.ndarray) -> None:
    for k, image in enumerate(grey):
        write_png(path / "depth" / f"{k}.png", image)
    rows = [f"{k} depth/{k}.png {k} rgb/{k}.png" for k in range(len(grey))]
    (path / "associations.txt").write_text("\n".join(rows))


def open3d(path: Path, grey: np.ndarray) -> None:
    for k, image in enumerate(grey):
        write_png(path / "depth" / f"{k:05d}.png", image)
    fx, fy, cx, cy = LENS
    values = {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": [fx, 0, 0, 0, fy, 0, cx, cy, 1]}
    more = {"depth_scale": 4000.0, "fps": 15.0, "device_name": "Intel RealSense D435", "serial_number": "0123"}
    (path / "intrinsic.json").write_text(json.dumps(values | more))


def redwood(path: Path, grey: np.ndarray) -> None:
    for k, image in enumerate(grey):
        write_png(path / "depth" / f"{k + 1:07d}-{33369 * k:012d}.png", image)


def scannet(path: Path, grey: np.ndarray) -> None:
    for k, image in enumerate(grey):
        write_png(path / "depth" / f"{k}.png", image)
        (path / "pose").mkdir(exist_ok=True)
        pose = np.eye(4)
        pose[0, 3] = 0.1 * k
        np.savetxt(path / "pose" / f"{k}.txt", pose)
    fx, fy, cx, cy = LENS
    (path / "intrinsic").mkdir()
    np.savetxt(path / "intrinsic" / "intrinsic_depth.txt", [[fx, 0, cx, 0], [0, fy, cy, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def stray(path: Path, grey: np.ndarray) -> None:
    for k, image in enumerate(grey):
        write_png(path / "depth" / f"{k:06d}.png", image)
        write_png(path / "confidence" / f"{k:06d}.png", np.full((HEIGHT, WIDTH), 2, np.uint8))
    fx, fy, cx, cy = (1600.0, 1601.0, 960.5, 719.5)
    np.savetxt(path / "camera_matrix.csv", [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], delimiter=", ")
    rows = [f"{5.000001 + k / 60:.6f}, {k:06d}, 0.1, 0.2, 0.3, 0, 0, 0, 1" for k in range(len(grey))]
    (path / "odometry.csv").write_text("\n".join(["timestamp, frame, x, y, z, qx, qy, qz, qw", *rows]))


def npy(path: Path, grey: np.ndarray) -> None:
    np.save(path.with_suffix(".npy"), grey.astype(">u2"))
    path.with_suffix(".npy").rename(path)


def mat(path: Path, grey: np.ndarray) -> None:
    import scipy.io

    with path.open("wb") as file:
        scipy.io.savemat(file, {"depth": np.moveaxis(grey, 0, 2), "note": "x"}, do_compression=True)


def raw_file(path: Path, grey: np.ndarray) -> None:
    path.write_bytes(grey.astype(">u2").tobytes())
    sidecar(path.with_suffix(".json"), byte_order="big")


def raw_folder(path: Path, grey: np.ndarray) -> None:
    path.mkdir()
    for k, image in enumerate(grey):
        (path / f"{k}.raw").write_bytes(image.astype("<u2").tobytes())
    sidecar(path / "depth.json")


def sidecar(path: Path, **more: object) -> None:
    fx, fy, cx, cy = LENS
    lens = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    size = {"width": WIDTH, "height": HEIGHT, "depth_scale": 0.001, "fps": 30.0, "serial": "S1"}
    path.write_text(json.dumps({"format": "depth-sidecar", "version": 1, **size, "intrinsics": lens, **more}))


def r3d(path: Path, depth_m: np.ndarray) -> None:
    """(frames, height, width) float32 metres; needs lzfse."""
    import lzfse

    count, high, wide = depth_m.shape
    matrix = [1000.0, 0, 0, 0, 1001.0, 0, 15 * wide - 0.5, 15 * high - 0.5, 1]
    stamps = [100.000001 + k / 60 for k in range(count)]
    values = {"w": 30 * wide, "h": 30 * high, "dw": wide, "dh": high, "fps": 60, "K": matrix}
    poses = [[0, 0, 0, 1, 0.5 * k, 0, 0] for k in range(count)]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata", json.dumps(values | {"frameTimestamps": stamps, "poses": poses}))
        for k, image in enumerate(depth_m):
            archive.writestr(f"rgbd/{k}.depth", lzfse.compress(image.astype("<f4").tobytes()))


FORMATS: dict[str, Callable[[Path, np.ndarray], None]] = {
    write.__name__: write
    for write in (plain_folder, pgm_folder, tum, icl, open3d, redwood, scannet, stray, npy, mat, raw_file, raw_folder)
}
"""What writes uint16 images in each format."""
