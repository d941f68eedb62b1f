"""Self-contained web pages from Jinja templates, and tables of words: files beside the modules that use them."""

from __future__ import annotations

import csv
from functools import cache
from importlib import resources
from typing import Final

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

HEAD_PACKAGE: Final = "anchorpose.results"
"""Holds ``page_head.html``, the head that all pages include."""


def render_page(package: str, template: str, **values: object) -> str:
    """The filled template, a file of ``package``; every value is escaped unless it is ``Markup``.

    Templates include others of the package and ``page_head.html``, which needs a ``title``, by name;
    ``inline(name)`` puts in a file as it is. Raises jinja2.UndefinedError for a value that is missing.
    """
    return _environment(package).get_template(template).render(values)


@cache
def _environment(package: str) -> Environment:
    loader = ChoiceLoader([PackageLoader(place, "") for place in dict.fromkeys((package, HEAD_PACKAGE))])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["inline"] = lambda name: Markup(loader.get_source(environment, name)[0])
    return environment


def read_words(package: str, name: str) -> list[dict[str, str]]:
    """The rows of a CSV of ``package``, by the names of their columns."""
    return list(csv.DictReader(resources.files(package).joinpath(name).read_text("utf-8").splitlines()))
