"""From what, with what and how long: versions, cameras, residuals, times, settings and the hashes of all inputs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import Any

from anchorpose.report.session import Session
from anchorpose.report.table import row, table
from anchorpose.report.words import counted, escape, spaced


def provenance(session: Session) -> str:
    """HTML: tables that open one by one."""
    run = session.run
    measured = session.definition.anchorpose if session.definition else "measures.parquet does not say"
    versions = [*run.get("versions", {}).items(), ("the measures: anchorpose", measured)]
    cameras = [(camera["name"], camera["source"], _position(camera)) for camera in run.get("cameras", [])]
    residuals = [
        (r["camera"], r["what"], f"{r['value']:.4g} {r['unit']}".replace(" 1", "")) for r in run.get("residuals", [])
    ]
    timings = [(timing["stage"], f"{timing['seconds']:.1f}") for timing in run.get("timings", [])]
    return "".join(
        [
            _table("Versions", ("program", "version"), versions),
            _table("Cameras", ("camera", "pose from", "stands at x, y, z in metres"), cameras),
            _table("What calibration left unexplained", ("camera", "what", "value"), residuals),
            _table("The patient's body as learnt", ("what", "value"), _body(run.get("body"))),
            _table("Time spent", ("stage", "seconds"), timings),
            _folded("Settings", f"<pre>{escape(json.dumps(run.get('config'), indent=1, ensure_ascii=False))}</pre>"),
            _table("Input files", ("file", "SHA-256"), _inputs(run.get("inputs_sha256", {}))),
        ]
    )


def _inputs(hashes: dict[str, str]) -> list[tuple[str, str]]:
    """Every file but the numbered pictures, of which a camera's are told by one hash of all their hashes."""
    pictures: dict[str, list[str]] = {}
    named = []
    for file, digest in sorted(hashes.items()):
        folder, _, name = file.rpartition("/")
        if name.split(".")[0].isdigit():
            pictures.setdefault(folder, []).append(digest)
        else:
            named.append((file, digest))
    together = [
        (f"{folder}: {counted(len(digests), 'picture')}, the hash of their hashes in run.json, in order of names",
         hashlib.sha256("\n".join(digests).encode("ascii")).hexdigest())
        for folder, digests in pictures.items()
    ]  # fmt: skip
    return named + together


def _position(camera: dict[str, Any]) -> str:
    pose = camera.get("camera_to_world")
    return "not used" if pose is None else ", ".join(f"{row[3]:.2f}" for row in pose[:3])


def _body(body: dict[str, Any] | None) -> list[tuple[str, str]]:
    if body is None:
        return [("no body was learnt", "")]
    lengths = [
        (spaced(str(bone["bone"])), f"{1000 * bone['length_m']:.0f} ± {1000 * bone['sigma_m']:.0f} mm (one sigma)")
        for bone in body["bones"]
    ]
    height = f"{body['height_m']:.3f} ± {body['height_sigma_m']:.3f} m (one sigma)"
    return [("height without shoes", height), ("thickness of clothes", f"{1000 * body['clothing_m']:.0f} mm"), *lengths]


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return _folded(title, "<p>run.json says nothing of this.</p>")
    body = "".join(row(first, [escape(cell) for cell in rest]) for first, *rest in rows)
    return _folded(title, table(title, head, f"<tbody>{body}</tbody>", "facts"))


def _folded(title: str, content: str) -> str:
    return f"<details><summary>{title}</summary>{content}</details>"
