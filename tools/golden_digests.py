"""Digests and a summary of a results folder, and how two of them differ."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow.parquet as pq

from anchorpose.joints import JOINT_NAMES, STATE_CODE, JointState
from anchorpose.results.tables import read_joints

Digests = dict[str, dict[str, str]]
"""By file, then by part: columns of a table, keys of a record; the part ``WHOLE`` is the file."""
Summary = dict[str, Any]

WHOLE: Final = "all"
RECORDING: Final = "recording"
DIGITS: Final = 12  # hexadecimal; no two contents agree by accident, and the stored file stays small
LEFT_OUT: Final = frozenset({"timings", "machine", "versions", "code", "identity", "outputs_sha256", "sources_sha256"})
"""Keys of run.json and export.json that change with each run, machine or edit, or follow from files digested here."""
SHARES: Final = ("upright_share", "assistance_share_upright")
TOLERANCES: Final = {"joints_mm": 30.0, "cameras_mm": 5.0, "height_mm": 5.0, "states": 0.1, "shares": 0.35}
"""How far the values of another machine may be off. With the code for processors without AVX and FMA, and OpenBLAS for
a Nehalem core, these eight moved by up to 15 mm (observed joints), 0.3 mm (a camera whose pose is found), 1 mm (height)
and 0.05 (states). Twice that and more is allowed. Of three frames, one changes a share by a third. Joints that are not
observed are left out: a hidden leg went elsewhere, 40 cm away."""


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGITS]


def digest_of_folder(folder: Path) -> str:
    """Over names and contents of all files."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    lines = [f"{path.relative_to(folder).as_posix()} {digest(path.read_bytes())}\n" for path in files]
    return digest("".join(lines).encode())


def digests_of(results: Path) -> Digests:
    """Of tables, run.json, pictures and exports. The log and the report state times, and are left out."""
    wanted = ("*.parquet", "run.json", "pictures/*.png", "exports/**/*")
    files = sorted(path for pattern in wanted for path in results.glob(pattern) if path.is_file())
    return {path.relative_to(results).as_posix(): _parts(path) for path in files}


def _parts(path: Path) -> dict[str, str]:
    if path.suffix == ".parquet":
        table = pq.read_table(path)
        columns = {name: digest(repr(table[name].to_pylist()).encode()) for name in table.column_names}
        return {WHOLE: digest(path.read_bytes()), **columns}
    if path.name in ("run.json", "export.json"):
        kept = {key: value for key, value in json.loads(path.read_text("utf-8")).items() if key not in LEFT_OUT}
        keys = {key: digest(json.dumps(value).encode()) for key, value in kept.items()}
        return {WHOLE: digest(json.dumps(kept).encode()), **(keys if path.name == "run.json" else {})}
    return {WHOLE: digest(path.read_bytes())}


def differences(expected: Digests, found: Digests) -> list[str]:
    """One line per file that differs, with the columns or keys that do."""
    lines = []
    for file in sorted({**expected, **found}, key=lambda name: name != RECORDING):
        before, now = expected.get(file), found.get(file)
        if before is None or now is None:
            lines.append(f"{file} is {'new' if before is None else 'missing'}")
        elif before != now and file == RECORDING:
            lines.append("the recording differs: the simulator changed; what follows may come from that")
        elif before != now:
            parts = [part for part in {**before, **now} if part != WHOLE and before.get(part) != now.get(part)]
            alike = "the same values in other bytes" if len(now) > 1 else "differs"
            lines.append(f"{file}: {', '.join(parts) or alike}")
    return lines


def summary_of(results: Path) -> Summary:
    """What hardly depends on the machine: joints observed in the last frame, cameras, height, shares of states.

    None where there is no value; mm and world frame.
    """
    joints = read_joints(results / "joints.parquet")
    run = json.loads((results / "run.json").read_text("utf-8"))
    rows = pq.read_table(results / "measures.parquet").to_pylist()
    seen = joints.state_code[-1] == STATE_CODE[JointState.OBSERVED]
    places = {camera["name"]: np.array(camera["camera_to_world"])[:3, 3] for camera in run["cameras"]}
    return {
        "joints_mm": {
            name: _millimetres(place) if known else None
            for name, place, known in zip(JOINT_NAMES, joints.position_m[-1], seen, strict=True)
        },
        "cameras_mm": {name: _millimetres(place) for name, place in places.items()},
        "height_mm": {"patient": None if run["body"] is None else _millimetres(run["body"]["height_m"])},
        "states": {str(state): float((joints.state_code == STATE_CODE[state]).mean().round(4)) for state in JointState},
        "shares": {row["measure"]: row["value"] for row in rows if row["measure"] in SHARES},
    }


def _millimetres(metres: Any) -> Any:
    """To a tenth."""
    return (1000 * np.asarray(metres)).round(1).tolist()


def beyond_tolerance(expected: Summary, found: Summary) -> list[str]:
    """One line per kind of value that differs by more than ``TOLERANCES`` allow.

    A joint that only one of the two observed counts in the shares of states; any other such value is a difference.
    """
    lines = []
    for kind, allowed in TOLERANCES.items():
        before, now = expected[kind], found[kind]
        names = [name for name in {**before, **now} if _apart(before.get(name), now.get(name), kind) > allowed]
        if names:
            worst = ", ".join(f"{name} {before.get(name)}, now {now.get(name)}" for name in names)
            lines.append(f"{kind}: more than {allowed} from the stored values: {worst}")
    return lines


def _apart(before: Any, now: Any, kind: str) -> float:
    if before is None or now is None:
        return 0.0 if before is now or kind == "joints_mm" else np.inf
    return float(np.linalg.norm(np.subtract(before, now)))
