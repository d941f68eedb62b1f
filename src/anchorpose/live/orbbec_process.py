"""Read one Orbbec camera and write its depth images to standard output, in a separate process (``live.cameras``).

pyorbbecsdk2 needs packages that conflict with the packages of anchorpose. So this file imports nothing of anchorpose,
and runs in any Python that has pyorbbecsdk2: python orbbec_process.py [SERIAL]. The process writes one line of JSON
with the lens, then for each image a header (number, device time in microseconds, host time in microseconds, metres per
grey value, number of bytes) and the grey values. On an error, the process writes one line to standard error and ends
with exit code 2.
"""

import json
import os
import struct
import sys
import time
from typing import BinaryIO

HEADER = struct.Struct("<qqqdq")
WAIT_MS = 200
STALL_S = 5.0


def main() -> int:
    """Open the camera, and write its images until standard output is closed; return the exit code."""
    out = claim_output()
    import pyorbbecsdk as ob

    serial = sys.argv[1] if len(sys.argv) > 1 else ""
    devices = ob.Context().query_devices()
    if devices.get_count() == 0:
        return refuse("no Orbbec camera is connected; check its cable and the udev rules of its maker")
    try:
        device = devices.get_device_by_serial_number(serial) if serial else devices.get_device_by_index(0)
    except ob.OBError as error:
        return refuse(f"there is no Orbbec camera with the serial number {serial} ({error})")
    pipeline, config = ob.Pipeline(device), ob.Config()
    profile = pipeline.get_stream_profile_list(ob.OBSensorType.DEPTH_SENSOR).get_default_video_stream_profile()
    config.enable_stream(profile)
    pipeline.start(config)
    try:
        problem = stream(out, pipeline, profile, device.get_device_info())
    except BrokenPipeError:
        return 0
    finally:
        pipeline.stop()
    # the reason is printed last, after ``pipeline.stop``, which may print, too: anchorpose shows the last line of
    # standard error as the reason
    return refuse(problem)


def claim_output() -> BinaryIO:
    """Return standard output as a binary file that only this program writes to. Everything else that is printed goes to
    standard error: Orbbec's library prints to standard output when it is imported, and later on errors.
    """
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return out


def stream(out: BinaryIO, pipeline, profile, info) -> str:  # type: ignore[no-untyped-def]
    """Write the lens, then images to ``out``; return the reason if the camera delivers no more images."""
    lens, bent = profile.get_intrinsic(), profile.get_distortion()
    about = {
        "name": info.get_name(),
        "serial": info.get_serial_number(),
        "width": profile.get_width(),
        "height": profile.get_height(),
        "intrinsics": [lens.fx, lens.fy, lens.cx, lens.cy],
        "distortion": [bent.k1, bent.k2, bent.p1, bent.p2, bent.k3, bent.k4, bent.k5, bent.k6],
    }
    out.write(json.dumps(about).encode() + b"\n")
    out.flush()
    last_s = time.monotonic()
    while time.monotonic() - last_s < STALL_S:
        frames = pipeline.wait_for_frames(WAIT_MS)
        depth = None if frames is None else frames.get_depth_frame()
        if depth is None:
            continue
        last_s = time.monotonic()
        data = bytes(depth.get_data())
        times = depth.get_timestamp_us(), depth.get_system_timestamp_us()
        out.write(HEADER.pack(depth.get_index(), *times, depth.get_depth_scale() / 1000.0, len(data)) + data)
        out.flush()
    return f"no image came for {STALL_S:.0f} s; check the camera's cable"


def refuse(sentence: str) -> int:
    """Print ``sentence``, the reason why no images can be read, and return the exit code 2."""
    print(sentence, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
