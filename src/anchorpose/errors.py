"""Define the errors that users see. Each message is one sentence with a remedy."""

from __future__ import annotations

import copyreg
import re
from pathlib import Path
from typing import Any, Final

_PASSWORD: Final = re.compile(r"(\b[\w+.-]+:/{1,2}[^\s/@:]*):(?!\d{1,5}(?:/|\s|$))\S*@")  # digits after ":" are a port
_SECRET: Final = re.compile(r"([?&][^=\s&]*(?:token|key|secret|sig|password|credential)[^=\s&]*=)[^&\s]+", re.I)


def without_password(text: str) -> str:
    """Replace every password or key in the addresses (URLs) of a text by three stars."""
    return _SECRET.sub(r"\1***", _PASSWORD.sub(r"\1:***@", text))


def is_utf8(text: str) -> bool:
    """Return whether a text can be written in UTF-8. Names of files and arguments of commands may contain bytes that
    are not valid text.
    """
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


class AnchorposeError(Exception):
    """An error that the user can correct; the command line prints its message and exits with status 2."""

    def __reduce__(self) -> tuple[Any, ...]:
        # pickle uses this value to restore an error that a worker process raised. The error is restored without a call
        # of ``__init__``, since ``args`` are not the arguments of ``__init__``
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class InputError(AnchorposeError):
    """The error for a file that cannot be used. It states the file's path, the problem and the remedy."""

    def __init__(self, path: Path | str, problem: str, remedy: str) -> None:
        self.path, self.problem, self.remedy = Path(without_password(str(path))), without_password(problem), remedy
        place = without_password(str(path))
        super().__init__(f"{place}: {' '.join(self.problem.split())}; {remedy}.")  # file names may contain line breaks


class MissingPackage(AnchorposeError):
    """The error for an optional package that is not installed. It states the purpose of the package, and how to install
    it.
    """

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f"{purpose} needs the package {package}; install it with: pip install 'anchorpose[{extra}]'.")


class DegenerateGeometry(AnchorposeError):
    """The error for points that do not determine a result, because they are too few, collinear or in one plane."""
