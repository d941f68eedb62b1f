"""What checks a change, on a developer's machine and on GitHub: the same tools, in fixed versions."""

import re
from pathlib import Path
from typing import Any

import pytest

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def steps(workflow: Path) -> list[dict[str, Any]]:
    jobs = yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"]
    return [step for job in jobs.values() for step in job["steps"]]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_every_action_has_a_full_version(workflow):
    used = [step["uses"] for step in steps(workflow) if "uses" in step]
    assert used
    assert [action for action in used if not re.fullmatch(r"actions/[a-z-]+@v\d+\.\d+\.\d+", action)] == []


def test_github_runs_what_is_run_before_a_merge_and_installs_from_the_locks():
    commands = [step["run"] for workflow in WORKFLOWS for step in steps(workflow) if "run" in step]
    assert "bash .ci/run" in commands
    installed = [line for text in commands for line in text.splitlines() if "pip install" in line]
    assert installed
    assert [
        line for line in installed if not re.search(r"-r requirements(-dev)?\.lock|--no-build-isolation", line)
    ] == []


def test_the_hooks_before_a_commit_are_those_of_ci():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"][0]["hooks"]
    in_ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for hook in hooks:
        command = hook["entry"].replace(" --force-exclude", "")
        assert re.search(rf"^{re.escape(command)}\b", in_ci, re.MULTILINE), command
