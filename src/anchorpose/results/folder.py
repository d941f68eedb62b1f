"""Folders and files that are written completely or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from anchorpose.errors import InputError

RESULTS_MARKS: Final = ("run.json", "joints.parquet")
"""The files by which a results folder of this program is recognised, so that it may be replaced."""


@contextmanager
def new_results_folder(
    path: Path, recording: Path, overwrite: bool = False, marks: tuple[str, ...] = RESULTS_MARKS
) -> Iterator[Path]:
    """A folder to write results of ``recording`` into that becomes ``path`` at the end; see ``whole_or_nothing``.

    An existing result, known by the files ``marks``, is replaced only with ``overwrite``; any other folder that
    is not empty is never touched. Raises InputError before anything is written where results may not go to ``path``.
    """
    check_results_path(path, recording, overwrite, marks)
    with whole_or_nothing(path) as partial:
        yield partial


@contextmanager
def whole_or_nothing(path: Path) -> Iterator[Path]:
    """A folder beside ``path`` that takes its place when the block ends without an error, and vanishes otherwise.

    What stood at ``path`` is replaced: the caller has made sure that it may be. Raises InputError where nothing can be
    written there.
    """
    target = path.resolve()
    made = [folder for folder in target.parents if not folder.exists()]
    partial = target.parent / f".{target.name}.partial-{os.getpid()}"
    try:
        partial.mkdir(parents=True)
    except OSError as error:
        raise InputError(path, f"cannot be made ({error.strerror})", "choose a place that you may write to") from None
    try:
        yield partial
        _replace(target, partial)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        _remove_empty(made)
        raise


def write_text_whole(path: Path, text: str) -> None:
    """Writes a text file in UTF-8 so that ``path`` holds all of it, or what it held before."""
    partial = path.with_name(f".{path.name}.partial-{os.getpid()}")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def check_results_path(path: Path, recording: Path, overwrite: bool, marks: tuple[str, ...] = RESULTS_MARKS) -> None:
    """Raises InputError unless results of ``recording`` may be written to ``path``; marks: files of such results."""
    target, source = path.resolve(), recording.resolve()
    if target.is_relative_to(source):
        raise InputError(path, "lies inside the recording", "choose a results folder outside of it")
    if source.is_relative_to(target):
        raise InputError(path, "holds the recording itself", "choose another results folder")
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise InputError(path, "is a file or a link", "choose another name for the results folder")
    if not path.exists() or not any(path.iterdir()):
        return
    if not all((path / mark).is_file() for mark in marks):
        raise InputError(path, "exists and is not a results folder", "choose another name; nothing in it was touched")
    if not overwrite:
        raise InputError(path, "exists already", "choose another name, or give --overwrite to replace it")


def _remove_empty(folders: list[Path]) -> None:
    with suppress(OSError):  # someone else has put something there: then it stays
        for folder in folders:
            folder.rmdir()


def _replace(target: Path, partial: Path) -> None:
    """Puts ``partial`` in the place of ``target``, which is ours or empty; the old one goes last."""
    if not target.exists():
        partial.rename(target)
        return
    old = target.parent / f".{target.name}.old-{os.getpid()}"
    target.rename(old)
    partial.rename(target)
    shutil.rmtree(old, ignore_errors=True)
