"""Count the size and shape of the code: python tools/count.py [COMMIT...]

One row per commit, or of the working tree as git lists it. *product* is ``src/anchorpose`` without ``research``
and ``simulate``. A constant is a module's name in capitals that is given a number, or something with a number in it. A
circle is a group of modules that import each other, imports for types included. Lines count everything, also blank.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parents[1]
PACKAGE: Final = "src/anchorpose/"
NOT_PRODUCT: Final = (f"{PACKAGE}research/", f"{PACKAGE}simulate/")
LONG, WIDE = 40, 8  # lines of a function, parameters of a function: more is counted
TITLES: Final = (
    "modules",
    "product lines",
    "constants",
    "functions > 40 lines",
    "> 8 parameters",
    "fmt: skip",
    "circles",
    "benchmarks lines",
    "tests lines",
)


@dataclass(frozen=True, slots=True)
class Shape:
    """One row of the table; see ``TITLES``."""

    counts: tuple[int, ...]


def shape_of(files: Mapping[str, str]) -> Shape:
    """Count the Python files of a checkout, by path from its root."""
    product = {
        path: text for path, text in files.items() if path.startswith(PACKAGE) and not path.startswith(NOT_PRODUCT)
    }
    trees = {path: ast.parse(text) for path, text in product.items()}
    functions = [node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return Shape(
        (
            len(product),
            _lines(product.values()),
            sum(len(list(_constants(tree))) for tree in trees.values()),
            sum((node.end_lineno or 0) - node.lineno >= LONG for node in functions),
            sum(len(node.args.args) + len(node.args.kwonlyargs) > WIDE for node in functions),
            sum(text.count("# fmt: skip") for text in product.values()),
            len(circles(trees)),
            _lines(text for path, text in files.items() if path.startswith("benchmarks/")),
            _lines(text for path, text in files.items() if path.startswith("tests/")),
        )
    )


def _lines(texts: Iterable[str]) -> int:
    return sum(text.count("\n") for text in texts)


def _constants(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        if isinstance(node, ast.Assign):
            targets, value = node.targets, node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets, value = [node.target], node.value
        else:
            continue
        if any(isinstance(part, ast.Constant) and type(part.value) in (int, float) for part in ast.walk(value)):
            flat = [one for target in targets for one in (target.elts if isinstance(target, ast.Tuple) else [target])]
            yield from (one.id for one in flat if isinstance(one, ast.Name) and one.id.lstrip("_").isupper())


def circles(trees: Mapping[str, ast.Module]) -> list[list[str]]:
    """Return the groups of modules that import each other, directly or through others."""
    names = {
        path.removeprefix("src/").removesuffix(".py").removesuffix("/__init__").replace("/", "."): path
        for path in trees
    }
    imports = {name: _imported(trees[path]) & names.keys() - {name} for name, path in names.items()}
    reach = {name: _reachable(name, imports) for name in imports}
    found = {frozenset(other for other in reach[name] if name in reach[other]) for name in imports}
    return sorted(sorted(group) for group in found if len(group) > 1)


def _imported(tree: ast.Module) -> set[str]:
    """Return the modules imported at the top of a module, also those only for types; a function may import late."""
    late = {
        id(node) for function in ast.walk(tree) if isinstance(function, ast.FunctionDef) for node in ast.walk(function)
    }
    found = set[str]()
    for node in ast.walk(tree):
        if id(node) in late:
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def _reachable(name: str, imports: Mapping[str, set[str]]) -> set[str]:
    seen, waiting = set[str](), [name]
    while waiting:
        for other in imports[waiting.pop()] - seen:
            seen.add(other)
            waiting.append(other)
    return seen


def files_at(commit: str | None) -> dict[str, str]:
    """Return the text of every Python file of a commit, or of the working tree."""
    if commit is None:
        listed = _git("ls-files", "--cached", "--others", "--exclude-standard", "*.py").splitlines()
        return {path: (REPOSITORY / path).read_text("utf-8") for path in listed if (REPOSITORY / path).is_file()}
    listed = [path for path in _git("ls-tree", "-r", "--name-only", commit).splitlines() if path.endswith(".py")]
    return {path: _git("show", f"{commit}:{path}") for path in listed}


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=REPOSITORY, check=True, capture_output=True, text=True).stdout


def main() -> None:
    """Print the table."""
    print(f"| | {' | '.join(TITLES)} |\n|---|{'--:|' * len(TITLES)}")
    for commit in sys.argv[1:] or [None]:
        counts = shape_of(files_at(commit)).counts
        print(f"| {commit or 'now'} | {' | '.join(f'{count:,}' for count in counts)} |")


if __name__ == "__main__":
    main()
