"""Folders and files that are written completely or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.writable import check_place, new_folder, whole_file


@dataclass(frozen=True, slots=True)
class FolderKind:
    """How a folder that a verb writes is recognised, and which files in it are the verb's own.

    marks: files by which it is known, so that it may be replaced; own: patterns of paths in it, as of ``fnmatch``.
    Files that match none of them are the user's: they are kept when the folder is replaced.
    """

    marks: tuple[str, ...]
    own: tuple[str, ...]

    def is_at(self, folder: Path) -> bool:
        """Whether ``folder`` is one of this kind."""
        return all((folder / mark).is_file() for mark in self.marks)

    def owns(self, file: str) -> bool:
        """Whether a file, by its path in the folder, is the verb's own."""
        return is_own(file, self.own)


DISK_ERRORS: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)

RESULTS: Final = FolderKind(
    ("run.json", "joints.parquet"),
    ("run.json", "*.parquet", "report.html", "pictures/*", "log.jsonl", ".log.jsonl.lock", "earlier-patient-*/*"),
)


@contextmanager
def new_results_folder(
    path: Path, recording: Path, overwrite: bool = False, kind: FolderKind = RESULTS
) -> Iterator[Path]:
    """A folder to write results of ``recording`` into that becomes ``path`` at the end; see ``whole_or_nothing``.

    An existing result, known by its kind's marks, is replaced only with ``overwrite``; any other folder that is not
    empty is never touched. Raises InputError before anything is written where results may not go to ``path``.
    """
    check_results_path(path, recording, overwrite, kind)
    with whole_or_nothing(path, kind.own if overwrite else ()) as partial:
        yield partial


@contextmanager
def whole_or_nothing(path: Path, own: Sequence[str] = ()) -> Iterator[Path]:
    """A folder beside ``path`` that takes its place when the block ends without an error, and vanishes otherwise.

    own: patterns of the files that may be replaced; see ``publish``. Raises InputError where nothing can be written
    there, or ``path`` is a link.
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
    """Gives an error of the disk the place that was written to, where the system names none: a write that fails, as on
    a full disk, knows only its number."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno in DISK_ERRORS:
            error.filename = str(place)
        raise


def publish(made: Path, path: Path, own: Sequence[str] = ()) -> None:
    """Puts the finished folder ``made`` in the place of ``path``; what stands there is replaced where it is own.

    own: patterns of the files that may be deleted, as of ``fnmatch``; none: only an empty folder is replaced. Files of
    ``path`` that match none stay, in a folder ``NAME.kept`` beside it. Raises InputError, with all of ``made`` in a
    folder of another name, where something has appeared at ``path`` that may not be replaced.
    """
    target = path.resolve()
    if not own or not target.exists():
        try:
            os.rename(made, target)  # atomic; replaces an empty folder, and no other
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
    """Undoes a replacement that was killed half-way: the old folder was moved away, the new one is not there yet."""
    old = _replaced(target)
    if not os.path.lexists(target) and not old.is_symlink() and kind.is_at(old):
        old.rename(target)


def free_name(path: Path) -> Path:
    """``path``, or ``path`` with the first number behind it that is not taken."""
    names = (path if number == 1 else path.with_name(f"{path.name}-{number}") for number in range(1, 10**6))
    return next(name for name in names if not os.path.lexists(name))


def is_own(file: str, own: Sequence[str]) -> bool:
    """Whether the path of a file in its folder matches one of the patterns."""
    return any(fnmatch(file, pattern) for pattern in own)


def _keep_foreign(old: Path, own: Sequence[str], kept: Path) -> None:
    """Deletes the own files of ``old`` and moves the folder to ``kept`` if others are left."""
    for file in [file for file in old.rglob("*") if not file.is_dir() or file.is_symlink()]:
        if is_own(file.relative_to(old).as_posix(), own):
            file.unlink()
    for folder in sorted((folder for folder in old.rglob("*") if folder.is_dir()), reverse=True):
        with suppress(OSError):  # not empty
            folder.rmdir()
    with suppress(OSError):
        old.rmdir()
    if old.exists():
        old.rename(kept)


def write_text_whole(path: Path, text: str) -> None:
    """Writes a text file in UTF-8 so that ``path`` holds all of it, or what it held before."""
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8")


def check_results_path(path: Path, recording: Path | None, overwrite: bool, kind: FolderKind = RESULTS) -> None:
    """Raises InputError unless results of ``recording`` (None: of cameras) may be written to ``path``."""
    check_place(path, recording)
    target = path.resolve()
    if not path.is_symlink():
        _restore_replaced(target, kind)
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise InputError(path, "is a file or a link", "choose another name for the results folder")
    if os.path.ismount(target):
        raise InputError(path, "is where a disk is mounted", "choose a folder in it")
    if not path.exists() or not any(path.iterdir()):
        return
    if not kind.is_at(path):
        raise InputError(path, "exists and is not a results folder", "choose another name; nothing in it was touched")
    if not overwrite:
        raise InputError(path, "exists already", "choose another name, or give --overwrite to replace it")
