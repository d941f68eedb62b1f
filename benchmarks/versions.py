"""The versions of the code that are measured: this working tree, and a commit to compare it with."""

from __future__ import annotations

import hashlib
import io
import subprocess
import tarfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from recordings import DIGITS, code_of, digest_of

from anchorpose.body.config import Source

REPOSITORY: Final = Path(__file__).resolve().parents[1]
NOT_MEASURED: Final = "simulate/"  # part of the package that no result depends on
ARCHIVED: Final = ("src", "benchmarks", "tests/builders")  # a probe may use a builder of the tests


@dataclass(frozen=True, slots=True)
class Version:
    """Code in a folder with ``src`` and ``benchmarks``, and the settings that it is run with.

    digest: of all code and data that results depend on; settings: those of TrackConfig that differ from the defaults.
    """

    title: str
    root: Path
    digest: str
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def source(self) -> Path:
        """Return the folder to put on Python's path."""
        return self.root / "src"


def working_tree() -> Version:
    """Return the code as it stands."""
    return Version("now", REPOSITORY, _digest(REPOSITORY / "src"))


def without(source: str) -> Version:
    """Return the code as it stands with a source of proposals switched off, also as a reason to doubt a pose."""
    settings = {"registration": {"sources": [str(one) for one in Source if one != source]}}
    now = working_tree()
    return replace(now, title=f"without {source}", digest=digest_of(now.digest, source), settings=settings)


def at_commit(commit: str, cache: Path) -> Version:
    """Return the code of a commit, unpacked into ``cache`` once; raises SystemExit where git does not know it."""
    try:
        name = _git("rev-parse", "--short=12", f"{commit}^{{commit}}").decode().strip()
    except subprocess.CalledProcessError:
        raise SystemExit(f"--against: git knows no commit {commit}.") from None
    root = cache / "versions" / name
    if not root.exists():
        root.mkdir(parents=True)
        with tarfile.open(fileobj=io.BytesIO(_git("archive", name, *ARCHIVED))) as archive:
            archive.extractall(root, filter="data")
    return Version(name, root, _digest(root / "src"))


def commit_of_code() -> str:
    """Return the last commit that changed the program or its benchmarks. Raises SystemExit for uncommitted changes."""
    if changed := _git("status", "--porcelain", "--", *ARCHIVED).decode().strip():
        raise SystemExit(f"--docs: commit these first, since every figure names the commit it is of:\n{changed}")
    return _git("log", "-1", "--format=%h", "--abbrev=10", "--", *ARCHIVED).decode().strip()


def _git(*arguments: str) -> bytes:
    return subprocess.run(["git", *arguments], cwd=REPOSITORY, check=True, capture_output=True).stdout


def _digest(source: Path) -> str:
    package, digest = source / "anchorpose", hashlib.sha256()
    for path in sorted(package.rglob("*")):
        place = path.relative_to(package).as_posix()
        if path.is_file() and path.suffix in (".py", ".npz", ".weights") and not place.startswith(NOT_MEASURED):
            digest.update(place.encode() + b"\0" + hashlib.sha256(code_of(path)).digest())
    return digest.hexdigest()[:DIGITS]
