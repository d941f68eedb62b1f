"""docs/settings.md lists every setting of tracking with its default, and no other."""

import json
import re
import tomllib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from anchorpose.cli import app
from anchorpose.cli.settings_file import TABLES, tracking_settings
from anchorpose.tracker.config import TrackConfig

PAGE = (Path(__file__).parents[1] / "docs" / "settings.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| `([a-z0-9_.]+)` \| `(.+?)` \| .+ \|$", re.MULTILINE)


def defaults(config: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Dotted name and default of every setting, as the page shows them."""
    for field in fields(config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            yield from defaults(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, shown(value)


def shown(value: Any) -> str:
    """A value as it stands in a settings file, with four digits."""
    if isinstance(value, float):
        return repr(float(f"{value:.3g}" if value < 0.1 else f"{value:.4g}"))
    return "not set" if value is None else json.dumps(value)


def test_every_setting_is_in_the_page_once_with_its_default_and_nothing_else_is() -> None:
    rows = ROW.findall(PAGE)
    assert len(rows) == len(dict(rows))
    assert dict(rows) == dict(defaults(TrackConfig()))


def test_both_examples_are_accepted_and_mean_the_same(tmp_path: Path) -> None:
    toml = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    as_json = re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)
    assert [tomllib.loads(text) for text in toml] == [json.loads(text) for text in as_json]
    (tmp_path / "settings.toml").write_text(toml[0], encoding="utf-8")
    assert tracking_settings(tmp_path / "settings.toml").follow.bystanders is False
    for command in (["track", "r", "-o", "out"], ["view", "out"]):
        app.parse_args([*command, "--config", str(tmp_path / "settings.toml")], exit_on_error=False, print_error=False)


def test_the_page_names_every_verb_that_may_have_a_table() -> None:
    sentence = re.search(r"to its command alone\. (.*?)\s+may have a table", PAGE, re.DOTALL)
    assert sentence is not None
    assert tuple(re.findall(r"`(\w+)`", sentence.group(1))) == TABLES
