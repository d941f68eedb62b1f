"""C3D of any maker, by ezc3d: points in the unit of POINT:UNITS, angles as listed in POINT:ANGLES."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from anchorpose.agreement.captured import Captured, checked, metres_per_unit, repeated_label
from anchorpose.errors import InputError, MissingPackage
from anchorpose.recording.regular_file import LARGEST_TABLE, require_regular


def read_c3d(path: Path, unit: str | None = None) -> Captured:
    """Points and angles of a C3D; unit: of its lengths, where the file does not state it or states it wrongly.

    A point is missing where its residual is negative. Unlabelled points (``*12``) are left out; a subject's name before
    a colon is too. Raises InputError, MissingPackage without ezc3d.
    """
    try:
        import ezc3d
    except ImportError:
        raise MissingPackage("evaluate --reference with a C3D", "ezc3d", "c3d") from None
    try:
        require_regular(path, LARGEST_TABLE)
        file = ezc3d.c3d(str(path))
        group = file["parameters"]["POINT"]
        places = np.asarray(file["data"]["points"], dtype=np.float64)[:3].transpose(2, 1, 0)
        residual = np.asarray(file["data"]["meta_points"]["residuals"], dtype=np.float64)[0].T
        rate_hz, first = float(file["header"]["points"]["frame_rate"]), int(file["header"]["points"]["first_frame"])
    except (OSError, RuntimeError, KeyError, IndexError, ValueError, SystemError) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0][:80]
        raise InputError(path, f"cannot be read as C3D ({reason})", "export it again from the other system") from None
    labels = _labels(group)[: places.shape[1]]
    listed = set(_texts(group, "ANGLES"))
    if rate_hz <= 0:
        raise InputError(path, "states no frame rate", "export it again from the other system")
    places = np.where((residual < 0)[:, :, None], np.nan, places[:, : len(labels)])
    is_angle = np.array([label in listed for label in labels], dtype=bool)
    own = np.array([not label.startswith("*") and bool(label) for label in labels], dtype=bool) & ~is_angle
    scale = metres_per_unit(path, (_texts(group, "UNITS") or (None,))[0], unit) if own.any() else 1.0
    names = tuple(_plain(label) for label, keep in zip(labels, own, strict=True) if keep)
    repeated_label(path, names)
    return checked(
        Captured(
            path,
            (first + np.arange(len(places))) / rate_hz,
            names,
            scale * places[:, own],
            tuple(_plain(label) for label, keep in zip(labels, is_angle, strict=True) if keep),
            places[:, is_angle, 0],
        )
    )


def _labels(group: Any) -> tuple[str, ...]:
    """LABELS goes on in LABELS2 and so on where there are more than 255 points."""
    names = [name for name in group if name.startswith("LABELS")]
    return tuple(label for name in sorted(names, key=lambda one: (len(one), one)) for label in _texts(group, name))


def _texts(group: Any, name: str) -> tuple[str, ...]:
    return tuple(str(text).strip() for text in group[name]["value"]) if name in group else ()


def _plain(label: str) -> str:
    return label.rsplit(":", 1)[-1]
