"""Export a results folder: every format into a folder of its own, all of them or none."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from glob import escape
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from anchorpose import __version__
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.exports.bids import write_bids
from anchorpose.exports.bvh import write_bvh
from anchorpose.exports.c3d import write_c3d
from anchorpose.exports.csv_tables import write_csv
from anchorpose.exports.formats import Format, Product, Source, read_source
from anchorpose.exports.opensim_coordinates import write_mot
from anchorpose.exports.opensim_trc import write_trc
from anchorpose.options import ExportConfig
from anchorpose.recording.document import read_json
from anchorpose.recording.writable import check_place
from anchorpose.results.folder import whole_or_nothing
from anchorpose.results.run_record import hash_files

RECORD_FILE: Final = "export.json"
EXPORTS_FOLDER: Final = "exports"

_WRITERS: Final[dict[Format, Callable[[Path, Source, ExportConfig], Product]]] = {
    Format.TRC: write_trc,
    Format.MOT: write_mot,
    Format.C3D: write_c3d,
    Format.CSV: write_csv,
    Format.BVH: write_bvh,
    Format.BIDS: write_bids,
}


def export_results(
    results: Path, formats: Sequence[Format], config: ExportConfig, out: Path | None = None, overwrite: bool = False
) -> tuple[tuple[Path, Product], ...]:
    """Writes ``out``/trc, ``out``/csv and so on, each with its export.json; returns each folder with its product.

    out: by default the folder ``exports`` in the results. Folders of earlier exports are replaced with ``overwrite``
    only; other folders and files are never touched. Raises InputError or MissingPackage, and then nothing was written.
    """
    target = out if out is not None else results / EXPORTS_FOLDER
    if not results.is_dir():
        raise InputError(results, "there is no such folder", "give a results folder made by 'anchorpose track'")
    sha256 = hash_files(sorted(results.glob("*.parquet")), results)
    for kind in formats:
        _check_place(target / kind, results, overwrite)
    done = []
    with ExitStack() as places:
        for kind in formats:
            folder = places.enter_context(whole_or_nothing(target / kind, _own_files(target / kind)))
            product = _WRITERS[kind](folder, read_source(results, kind), config)
            _write_record(folder, kind, sha256, product)
            done.append((target / kind, product))
    return tuple(done)


def parse_formats(text: str) -> tuple[Format, ...]:
    """``trc,csv`` as formats, each once; raises AnchorposeError for an unknown name."""
    names = [name.strip().lower() for name in text.split(",")]
    for name in names:
        if name not in tuple(Format):
            raise AnchorposeError(
                f"--to '{name}' is not a format; choose from {', '.join(Format)}, with commas between."
            )
    return tuple(dict.fromkeys(Format(name) for name in names))


def _check_place(folder: Path, results: Path, overwrite: bool) -> None:
    check_place(folder)
    if folder.resolve() == results.resolve():
        raise InputError(folder, "is the results folder itself", "choose another folder with -o")
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError(folder, "is a file or a link", "choose another folder with -o")
    if not folder.exists() or not any(folder.iterdir()):
        return
    if not (folder / RECORD_FILE).is_file():
        raise InputError(
            folder, "exists and is not an export", "choose another folder with -o; nothing in it was touched"
        )
    if not overwrite:
        raise InputError(folder, "exists already", "choose another folder with -o, or give --overwrite to replace it")


def _own_files(folder: Path) -> tuple[str, ...]:
    """The files of an earlier export in this folder, which may be replaced; none where there is none."""
    record = folder / RECORD_FILE
    files = read_json(record).get("files", []) if record.is_file() else []
    return (RECORD_FILE, *(escape(str(file)) for file in files)) if files else ()


def _write_record(folder: Path, kind: Format, sha256: tuple[tuple[str, str], ...], product: Product) -> None:
    """sha256: name and hash of each table of the results, in order of name."""
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    document: dict[str, Any] = {
        "format": "anchorpose-export",
        "version": 1,
        "to": str(kind),
        "versions": {"anchorpose": __version__, **{name: metadata.version(name) for name in product.tools}},
        "axes": product.axes,
        "units": product.units,
        "time": product.time,
        "missing": product.missing,
        "counts": dict(product.counts),
        "notes": list(product.notes),
        "files": files,
        "sources_sha256": dict(sha256),
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / RECORD_FILE).write_text(text + "\n", encoding="utf-8", newline="\n")
