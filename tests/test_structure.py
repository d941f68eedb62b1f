"""How the project is laid out: who imports whom, what an import costs, what a committed file may not hold."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pytest

import anchorpose
from anchorpose.research.experiment.plan import PRESENTING

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "anchorpose"

FLOW = (
    "recording",
    "descriptor",
    "calibration",
    "isolation",
    "surface",
    "geodesics",
    "motion",
    "body",
    "track_tree",
    "results",
    "report",
)
VALUES = ("errors", "joints", "camera", "lens", "rotations", "versions", "settings", "options", "threads")
BESIDE_THE_FLOW = (
    "simulate",
    "tracker",
    "pipeline",
    "writing",
    "track_inputs",
    "api",
    "cli",
    "live",
    "check",
    "research",
    "exports",
    "pages",
    "viewer",
    "sources",
    "batch",
    "agreement",
    "sync",
    "remote",
)
PACKAGE_ITSELF = "anchorpose"  # `from anchorpose import __version__`

HEAVY = {
    "numpy",
    "scipy",
    "numba",
    "cv2",
    "pyarrow",
    "embreex",
    "pydantic",
    "jinja2",
    "dask",
    "distributed",
    "onnxruntime",
}

# Put together from pieces, so that this file does not hold what it forbids.
MACHINE_PATH = re.compile(r"(?<![\w.~/])/(?:" + "|".join(("work", "root", "home", "Users", "opt", "tmp/lab")) + r")/")
REGISTRY = re.compile("|".join((r"pypi\.", r"pythonhosted\.", r"registry\.npm", r"deb\.debian", "index" + "-url")))


@cache
def nodes_of(module: Path) -> tuple[ast.AST, ...]:
    """Every node of a module's tree, read once for all tests."""
    return tuple(ast.walk(ast.parse(module.read_text(encoding="utf-8"))))


def imported_names(nodes: Iterable[ast.AST]) -> set[str]:
    """What is imported from anchorpose: stages, modules and the package itself; imports in functions count."""
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            dotted = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are written in full, so that this test can read them"
            dotted = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        own = [name.split(".") for name in dotted if name.split(".")[0] == "anchorpose"]
        names |= {PACKAGE_ITSELF if name[1:] in ([], ["__version__"]) else name[1] for name in own}
    return names


OPENING = {
    "os.open",
    "np.load",
    "np.loadtxt",
    "np.genfromtxt",
    "np.fromfile",
    "np.memmap",
    "np.lib.format.open_memmap",
    "cv2.imread",
    "pq.read_table",
    "pq.read_schema",
    "pq.ParquetFile",
    "pa.memory_map",
    "pa.OSFile",
    "pyarrow.csv.read_csv",
    "sqlite3.connect",
    "json.load",
    "tomllib.load",
    "shutil.copy",
    "shutil.copyfile",
    "shutil.copy2",
}
"""Functions that open a file for reading; beside them ``open`` and the methods of a path."""

OPENS_ITSELF = {
    "recording/regular_file.py": "the one place",
    "results/parquet.py": "pyarrow, of a path that refuse_unreadable asked about",
    "report/words.py": "a file of the package",
    "batch/summary.py": "pyarrow, of a path that refuse_unreadable asked about, and of a table that was just written",
    "research/benchmark/answers.py": "pyarrow, of a file that open_regular opened",
    "research/benchmark/truth.py": "np.loadtxt, of a text that read_text read",
    "sources/bag_file.py": "SQLite, of a path whose first bytes open_regular read",
    "agreement/captured.py": "ezc3d, of a path that require_regular asked about",
    "live/recorder.py": "copies of files that require_regular asked about",
    "research/benchmark/make.py": "a file of the package, and copies of images that were just written",
    "body/asset.py": "a file of the package",
    "body/joint_ranges.py": "a file of the package",
    "viewer/guarded_server.py": "files of the package",
    "versions.py": "the code itself",
    "research/experiment/method.py": "a Python file of the user that was just run",
    "research/experiment/plan.py": "results that the experiment stored",
    "research/experiment/run.py": "movements that the experiment stored",
    "research/experiment/pictures/album.py": "an account that the experiment stored",
    "simulate/write.py": "copies of images that were just written",
    "batch/worker.py": "the answer of a process that it started",
}
"""Modules that open files for reading without ``regular_file``, and why no pipe or device can be among these."""


def opens_a_file(call: ast.Call) -> bool:
    """Whether a call opens a file for reading; a mode that only writes is no reading."""
    name = ast.unparse(call.func)
    if name == "open" or name.endswith(".open"):
        modes = [
            each.value
            for each in (*call.args, *(key.value for key in call.keywords if key.arg == "mode"))
            if isinstance(each, ast.Constant)
        ]
        takes_path = name == "open" or not call.args or isinstance(call.args[0], ast.Constant)
        return name in OPENING or (takes_path and not any(set(str(mode)) & set("wax") for mode in modes))
    return name in OPENING or name.endswith((".read_text", ".read_bytes"))


def modules_of(name: str) -> list[Path]:
    """The modules of a stage, or the one module of that name."""
    return sorted((PACKAGE / name).rglob("*.py")) or [PACKAGE / f"{name}.py"]


def forbidden_imports(name: str, allowed: set[str]) -> list[str]:
    return [
        f"{module.relative_to(PACKAGE)} imports {unwanted}"
        for module in modules_of(name)
        for unwanted in sorted(imported_names(nodes_of(module)) - allowed)
    ]


def project_files() -> list[Path]:
    """Everything that is or could be committed; skips where this is no git work tree."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("this is no git work tree, so what is committed is not known")
    return [ROOT / name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def lines_of(path: Path) -> list[str]:
    """The lines of a text file; none of one that is not text."""
    content = path.read_bytes()
    return [] if b"\0" in content else content.decode("utf-8").splitlines()


def commands_of(path: Path) -> list[str]:
    """Commands chained with && in a README or a script, one string each, without their line breaks."""
    joined = re.sub(r"(&&|\\)\n\s*", r"\1 ", path.read_text(encoding="utf-8")).replace("\\ ", "")
    return [line.strip() for line in joined.splitlines() if line.strip().startswith("python3 -m venv")]


@pytest.mark.parametrize("stage", FLOW)
def test_a_stage_imports_only_what_stands_before_it_in_the_flow(stage: str) -> None:
    earlier = FLOW[: FLOW.index(stage) + 1]
    assert forbidden_imports(stage, {*earlier, *VALUES, PACKAGE_ITSELF}) == []


@pytest.mark.parametrize("value", VALUES)
def test_value_modules_import_nothing_but_each_other(value: str) -> None:
    assert forbidden_imports(value, {*VALUES, PACKAGE_ITSELF}) == []


WAYS = {*FLOW, *VALUES, "tracker", "pages", "track_inputs", "check", "writing"}
MAY_IMPORT: dict[str, set[str]] = {
    "tracker": {*FLOW, *VALUES, "tracker"},
    "check": {*FLOW, *VALUES, "tracker", "check"},
    **dict.fromkeys(("pipeline", "writing", "track_inputs", "pages"), WAYS),
    "exports": {*FLOW, *VALUES, "exports", PACKAGE_ITSELF},
    "agreement": {*FLOW, *VALUES, "agreement", PACKAGE_ITSELF},
    "sync": {*FLOW, *VALUES, "agreement", "sync", PACKAGE_ITSELF},
    "sources": {*VALUES, "recording", "results", "sources", PACKAGE_ITSELF},
    "simulate": {*VALUES, "recording", "body", "simulate"},
}
"""Nothing that tracks reaches the simulation and its truth; exports and comparisons read results and reach neither;
what reads recorders' files reaches no stage but the recording; the simulation uses no stage that is judged by it."""


@pytest.mark.parametrize("name", MAY_IMPORT)
def test_what_stands_beside_the_flow_imports_only_what_it_may(name: str) -> None:
    assert forbidden_imports(name, MAY_IMPORT[name]) == []


def test_nothing_of_the_product_imports_research_but_the_verbs_that_run_it() -> None:
    modules = [path for path in PACKAGE.rglob("*.py") if path.relative_to(PACKAGE).parts[0] != "research"]
    importing = [path for path in modules if "research" in imported_names(nodes_of(path))]
    names = {path.relative_to(PACKAGE).as_posix() for path in importing}
    assert names == {"cli/research_verbs.py"}


def test_only_the_console_prints() -> None:
    """It escapes what would act on a terminal. A camera's process prints to its parent, not to a terminal."""
    own = {PACKAGE / "cli" / "console.py", PACKAGE / "live" / "orbbec_process.py"}
    printing = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}"
        for path in sorted(set(PACKAGE.rglob("*.py")) - own)
        for node in nodes_of(path)
        if (isinstance(node, ast.Name) and node.id == "print")
        or (isinstance(node, ast.ImportFrom) and node.module == "rich.console")
    ]
    assert printing == []


def test_every_input_is_opened_as_a_regular_file() -> None:
    found = {
        module.relative_to(PACKAGE).as_posix(): ast.unparse(node)
        for module in PACKAGE.rglob("*.py")
        for node in nodes_of(module)
        if isinstance(node, ast.Call) and opens_a_file(node)
    }
    assert {name: call for name, call in found.items() if name not in OPENS_ITSELF} == {}
    assert set(OPENS_ITSELF) - set(found) == {"agreement/captured.py"}  # ezc3d: the same name makes a new file


def test_every_folder_and_module_has_a_place_in_the_layout() -> None:
    found = {path.stem for path in PACKAGE.iterdir() if not path.name.startswith("__") and path.name != "py.typed"}
    assert found == {*FLOW, *VALUES, *BESIDE_THE_FLOW}


def test_no_module_is_a_drawer_for_odds_and_ends() -> None:
    drawers = {"util", "utils", "common", "helper", "helpers", "misc", "tools"}
    assert [path for path in PACKAGE.rglob("*") if path.stem in drawers] == []


@pytest.mark.parametrize("arguments", [None, ["--help"], ["track", "--help"], ["demo", "--help"], ["--version"]])
def test_importing_and_asking_for_help_load_no_library_that_computes(arguments: list[str] | None) -> None:
    ask = "" if arguments is None else f"from anchorpose.cli import main; assert main({arguments}) == 0"
    script = f"import sys, anchorpose\n{ask}\nprint('loaded:', *sorted({HEAVY} & set(sys.modules)))"
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert answer.stdout.splitlines()[-1] == "loaded:"


def test_importing_the_package_imports_nothing_else_of_it() -> None:
    script = "import sys, anchorpose; print(*[name for name in sys.modules if name.startswith('anchorpose.')])"
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == ""


def test_the_version_is_written_once() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" not in project["project"]
    assert (ROOT / project["tool"]["hatch"]["version"]["path"]).read_text().count(f'"{anchorpose.__version__}"') == 1
    assert version("anchorpose") == anchorpose.__version__
    assert not re.search(r"^version:", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)


def test_committed_files_name_no_path_of_a_machine_and_no_registry() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
        for path in project_files()
        for number, line in enumerate(lines_of(path), 1)
        if MACHINE_PATH.search(line) or REGISTRY.search(line)
    ]
    assert found == []


def test_ci_runs_the_commands_of_the_readme() -> None:
    demo, tests = commands_of(ROOT / "README.md")
    in_ci = commands_of(ROOT / ".ci" / "run")
    assert tests in in_ci
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert f"    {tests.split(' && ')[-1]} -m thorough" in lines
    assert demo.endswith("anchorpose demo")
    assert any(command.startswith(demo) for command in in_ci)


@pytest.mark.parametrize(("lock", "extra"), [("requirements.lock", ()), ("requirements-dev.lock", ("dev",))])
def test_every_dependency_is_locked_with_hashes(lock: str, extra: tuple[str, ...]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *(line for name in extra for line in project["optional-dependencies"][name])]
    entries = re.split(r"\n(?=\S)", (ROOT / lock).read_text(encoding="utf-8"))
    locked = {entry.split("==")[0]: entry for entry in entries}
    assert {re.split(r"[\[<>=~]", line)[0] for line in wanted} <= set(locked)
    assert [name for name, entry in locked.items() if "--hash=sha256:" not in entry] == []


@pytest.mark.parametrize("lock", ["requirements.lock", "requirements-dev.lock"])
def test_what_builds_the_package_is_locked_and_nothing_else_is_fetched_for_it(lock: str) -> None:
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    entries = (ROOT / lock).read_text(encoding="utf-8").splitlines()
    locked = {line.split("==")[0] for line in entries if "==" in line}
    editable = {"editables"} if lock == "requirements-dev.lock" else set()  # what hatchling needs for pip install -e
    assert {re.split(r"[\[<>=~]", line)[0] for line in build} | editable <= locked
    for page in ("README.md", "CONTRIBUTING.md", "docs/index.md", ".ci/run"):
        commands = [line for line in (ROOT / page).read_text(encoding="utf-8").splitlines() if "--no-deps" in line]
        assert commands
        assert [line for line in commands if "--no-build-isolation" not in line] == []


def test_both_locks_agree_on_what_runs() -> None:
    dev = set((ROOT / "requirements-dev.lock").read_text(encoding="utf-8").splitlines())
    run = set((ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines())
    assert run <= dev


def test_what_a_result_of_the_experiment_depends_on_imports_nothing_that_only_presents() -> None:
    presenting = {place.split("/")[0].removesuffix(".py") for place in PRESENTING if "research" not in place}
    for folder in {*FLOW, "tracker", "simulate"} - {"report"}:
        assert (
            forbidden_imports(folder, {PACKAGE_ITSELF, *(path.stem for path in PACKAGE.iterdir())} - presenting) == []
        )
