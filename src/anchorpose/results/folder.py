"""Write folders and files completely or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import chain, count
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.writable import check_place, new_folder, whole_file


@dataclass(frozen=True, slots=True)
class FolderKind:
    """A kind of folder that a command writes: how it is recognised, and which files in it the command may replace.

    name: the kind's name in messages. marks: names of files by which the folder is recognised as replaceable. own:
    patterns (``fnmatch``) that match the paths of all files that the command writes. All other files are the user's and
    are kept when the folder is replaced.
    """

    name: str
    marks: tuple[str, ...]
    own: tuple[str, ...]

    def is_at(self, folder: Path) -> bool:
        """Return whether ``folder`` is of this kind."""
        return all((folder / mark).is_file() for mark in self.marks)


CALIBRATION: Final = FolderKind("a calibration", ("calibration.json",), ("calibration.json", "*.png"))

DISK_ERRORS: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)  # error numbers of failed writes

RESULTS: Final = FolderKind(
    "a results folder",
    ("run.json", "joints.parquet"),
    ("run.json", "*.parquet", "report.html", "pictures/*", "log.jsonl", ".log.jsonl.lock", "earlier-patient-*/*"),
)


@contextmanager
def new_results_folder(
    path: Path, recording: Path, overwrite: bool = False, kind: FolderKind = RESULTS
) -> Iterator[Path]:
    """Yield a new folder for results of ``recording``. When the ``with`` block ends without an error, the folder is
    moved to ``path``; after an error, it is removed.

    An existing result, recognised by the marks of its kind, is replaced only with ``overwrite``; any other folder that
    is not empty is never touched. Raises InputError, before writing anything, if ``path`` may not be replaced.
    """
    check_results_path(path, recording, overwrite, kind)
    with whole_or_nothing(path, kind.own if overwrite else ()) as partial:
        yield partial


@contextmanager
def whole_or_nothing(path: Path, own: Sequence[str] = ()) -> Iterator[Path]:
    """Yield a new folder beside ``path``. When the ``with`` block ends, the new folder replaces ``path``, or is removed
    if there was an error.

    own: patterns (``fnmatch``) of the files in ``path`` that may be deleted. Raises InputError if nothing can be
    written beside ``path``, or if ``path`` is a link.
    """
    if path.is_symlink():
        raise InputError(path, "is a link", "choose another name; nothing was touched")
    target = path.resolve()
    partial = target.parent / f".{target.name}.partial-{secrets.token_hex(4)}"
    with new_folder(partial, path):
        try:
            with naming_place(path):
                yield partial
                publish(partial, path, own)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise


@contextmanager
def naming_place(place: Path) -> Iterator[None]:
    """Add the path ``place`` to disk errors in the ``with`` block that state no path: a failed write, as on a full
    disk, states only an error number.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno in DISK_ERRORS:
            error.filename = str(place)
        raise


def publish(made: Path, path: Path, own: Sequence[str] = ()) -> None:
    """Move the finished folder ``made`` to ``path``, and delete the files that an earlier run has written there.

    own: patterns (``fnmatch``) of the files that may be deleted; without patterns, only an empty folder is replaced.
    Files of ``path`` that match no pattern are kept in a folder ``NAME.kept`` beside it. Raises InputError if a folder
    or file that may not be replaced has meanwhile appeared at ``path``; ``made`` is then moved to a folder of another
    name.
    """
    target = path.resolve()
    if not own or not target.exists():
        try:
            os.rename(made, target)  # atomic; replaces an empty folder, but never a folder that contains files
        except OSError:
            other = free_name(target)
            os.rename(made, other)
            problem = "appeared while its results were made, and was not touched"
            raise InputError(path, problem, f"the results are in {other}") from None
        return
    old = free_name(_replaced(target))
    target.rename(old)
    made.rename(target)
    _keep_foreign(old, own, free_name(target.with_name(f"{target.name}.kept")))


def _replaced(target: Path) -> Path:
    return target.with_name(f".{target.name}.replaced")


def _restore_replaced(target: Path, kind: FolderKind) -> None:
    """Move the old folder back to ``target`` if a run was killed after it moved the old folder away and before the new
    folder was in place.
    """
    old = _replaced(target)
    if not os.path.lexists(target) and not old.is_symlink() and kind.is_at(old):
        old.rename(target)


def free_name(path: Path) -> Path:
    """Return ``path`` if it is free, else ``path`` with the first free number appended."""
    names = chain([path], (path.with_name(f"{path.name}-{number}") for number in count(2)))
    return next(name for name in names if not os.path.lexists(name))


def _keep_foreign(old: Path, own: Sequence[str], kept: Path) -> None:
    """Delete the files in ``old`` that match a pattern in ``own``, and move the folder to ``kept`` if other files
    remain.
    """
    for file in [file for file in old.rglob("*") if not file.is_dir() or file.is_symlink()]:
        if any(fnmatch(file.relative_to(old).as_posix(), pattern) for pattern in own):
            file.unlink()
    for folder in [*sorted((folder for folder in old.rglob("*") if folder.is_dir()), reverse=True), old]:
        with suppress(OSError):  # a folder that is not empty stays
            folder.rmdir()
    if old.exists():
        old.rename(kept)


def write_text_whole(path: Path, text: str) -> None:
    """Write a text file in UTF-8 so that ``path`` holds either all of the text or its earlier content."""
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8")


def check_results_path(path: Path, recording: Path | None, overwrite: bool, kind: FolderKind = RESULTS) -> None:
    """Raise InputError unless results of ``recording`` (None for live cameras) may be written to ``path``."""
    check_place(path, recording)
    target = path.resolve()
    if not path.is_symlink():
        _restore_replaced(target, kind)
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise InputError(path, "is a file or a link", "choose another name")
    if os.path.ismount(target):
        raise InputError(path, "is the mount point of a disk", "choose a folder in it")
    if not path.exists() or not any(path.iterdir()):
        return
    if not kind.is_at(path):
        raise InputError(path, f"exists and is not {kind.name}", "choose another name; nothing in it was touched")
    if not overwrite:
        raise InputError(path, "exists already", "choose another name, or give --overwrite to replace it")
