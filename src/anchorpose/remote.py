"""Copy recordings and results from and to addresses (URLs) of servers that the package fsspec knows (sftp://, s3://,
gs://), so that the program works on local files.

Tracking reads every image more than once and writes tables continuously, so a local copy is faster than a stream.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any, Final
from urllib.parse import unquote

from anchorpose.errors import InputError, MissingPackage, without_password

EXTRAS: Final = {
    "sftp": ("sshfs", "sftp"),
    "ssh": ("sshfs", "sftp"),
    "s3": ("s3fs", "s3"),
    "gs": ("gcsfs", "gs"),
    "gcs": ("gcsfs", "gs"),
}
"""For each kind of address, the Python package that reads it and the extra of anchorpose that installs this package."""

# kinds of address of object stores (servers that store files by name, without folders)
OBJECT_STORES: Final = frozenset(("s3", "s3a", "gs", "gcs"))


def is_address(text: object) -> bool:
    """Return whether a text is an address rather than a path."""
    return isinstance(text, str) and "://" in text


def name_of(address: str) -> str:
    """Return the last part of an address, the name of the file or folder."""
    return parts_of(address)[-1]


def parts_of(address: str) -> tuple[str, ...]:
    """Return the parts of an address (host, folders, name of the file or folder), without user, password and query; if
    it has no parts, return ("recording",).
    """
    place = without_password(address).partition("://")[2].partition("?")[0].strip("/")
    return tuple(part for part in re.sub(r"^[^/]*@", "", place).split("/") if part) or ("recording",)


@contextmanager
def local_copy(given: str | Path) -> Iterator[Path]:
    """If ``given`` is a path, yield it unchanged; for an address, yield a local copy with the same name, which is
    removed after the ``with`` block.

    Raises InputError if the address is empty or cannot be read, MissingPackage if the package that reads this kind of
    address is not installed.
    """
    if not is_address(given):
        yield Path(given)
        return
    address = str(given)
    with TemporaryDirectory(prefix="anchorpose-") as folder:
        copy = Path(folder) / name_of(address)
        with _connected(address, "read") as (system, place):
            if not system.exists(place):
                raise InputError(address, "is not there", "check the address")
            files = system.find(place)
            local = [copy.joinpath(*_inside(address, file, place)) for file in files]
            for parent in {file.parent for file in local}:
                parent.mkdir(parents=True, exist_ok=True)
            system.get(files, [str(file) for file in local])
        yield copy


def _inside(address: str, file: str, place: str) -> tuple[str, ...]:
    """Return the parts of a file's path relative to the folder ``place``; raises InputError if the server names a file
    outside that folder.
    """
    parts = PurePosixPath(file).relative_to(place).parts
    if ".." in parts or any("\\" in part for part in parts):
        raise InputError(address, f"holds a file with the name {file}", "rename it")
    return parts


@contextmanager
def local_results(given: str | Path) -> Iterator[Path]:
    """If ``given`` is a path, yield it unchanged. If it is an address, yield the path of a local folder to be written,
    whose content is copied to the address when the block ends without an error.

    The local folder is copied to the server under a temporary name, and the copy is then renamed. An address that
    exists already is refused before any work, and never replaced. Raises InputError and MissingPackage, as
    ``local_copy`` does.
    """
    if not is_address(given):
        yield Path(given)
        return
    address = str(given)
    with _new_place(address):
        pass
    with TemporaryDirectory(prefix="anchorpose-") as folder:
        made = Path(folder) / name_of(address)
        yield made
        with _new_place(address) as (system, place):
            partial = f"{place}.partial-{secrets.token_hex(4)}"
            try:
                system.put(f"{made}/", f"{partial}/", recursive=True)
            except BaseException:
                with suppress(Exception):  # an error while the partial copy is removed must not hide the first error
                    system.rm(partial, recursive=True)
                raise
            _rename(system, partial, place)


@contextmanager
def _new_place(address: str) -> Iterator[tuple[Any, str]]:
    with _connected(address, "written") as (system, place):
        if system.exists(place):
            raise InputError(address, "exists already", "choose another name, or remove it there first")
        yield system, place


def _rename(system: Any, source: str, target: str) -> None:
    """Rename a folder, in a single step if possible. An object store has no folders: there, every file is copied to its
    new name, then deleted under its old name.
    """
    if OBJECT_STORES.isdisjoint((system.protocol,) if isinstance(system.protocol, str) else system.protocol):
        system.mv(source, target, recursive=True)
        return
    files = system.find(source)
    system.copy(files, [target + file.removeprefix(source) for file in files])
    system.rm(source, recursive=True)


@contextmanager
def _connected(address: str, use: str) -> Iterator[tuple[Any, str]]:
    """Yield the file system of an address and the path in it; any error becomes an AnchorposeError. use: "read" or
    "written", a word for the error's message.
    """
    kind = address.partition("://")[0]
    try:
        from fsspec.core import url_to_fs

        system, place = url_to_fs(address)
        system.invalidate_cache()
        yield system, place.rstrip("/")
    except InputError:
        raise
    except ImportError:
        package, extra = EXTRAS.get(kind, (f"that serves {kind}://", "sftp,s3,gs"))
        raise MissingPackage(f"An address that begins with {kind}://", package, extra) from None
    except Exception as error:  # each file system raises its own types of errors
        why = _without_own_password(str(error), address).splitlines()[0][:200] if str(error) else type(error).__name__
        remedy = "check the address, your access to it, and the connection"
        raise InputError(address, f"cannot be {use} ({why})", remedy) from error


def _without_own_password(text: str, address: str) -> str:
    """Replace the address's password in the text of an error, whether percent-encoded or not, by three stars."""
    given = re.search(r"://[^:/@]*:(.*)@", address)
    for password in () if given is None else sorted({given[1], unquote(given[1])}, key=len, reverse=True):
        text = text.replace(password, "***") if password else text
    return text
