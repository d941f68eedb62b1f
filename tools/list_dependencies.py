"""The packages that a user installs, with version and licence: python tools/list_dependencies.py requirements.lock.

Prints a Markdown table from what is installed; --cyclonedx prints a bill of materials in CycloneDX 1.5 (JSON) instead.
Licences are as each package states them.
"""

from __future__ import annotations

import argparse
import json
import re
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Package:
    """licence: empty where the package states none by name."""

    name: str
    version: str
    licence: str
    purpose: str


def packages_of(lock: Path) -> list[Package]:
    """All packages of a lock file that are installed, in its order."""
    names = re.findall(r"^([A-Za-z0-9_.-]+)==", lock.read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = []
    for name in names:
        try:
            found.append(_package(distribution(name)))
        except PackageNotFoundError:  # of another system
            continue
    return found


def _package(installed: Distribution) -> Package:
    about = installed.metadata
    stated = about["License-Expression"] or _classified(about.get_all("Classifier") or []) or about["License"] or ""
    licence = "" if "\n" in stated.strip() else stated.strip()  # some give the whole text instead of a name
    return Package(about["Name"], installed.version, licence, (about["Summary"] or "").strip())


def _classified(classifiers: list[str]) -> str:
    found = [text.rpartition(" :: ")[2] for text in classifiers if text.startswith("License ::")]
    return ", ".join(name for name in found if name != "OSI Approved")


def main() -> None:
    """Prints the list."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("lock", type=Path)
    parser.add_argument("--cyclonedx", action="store_true")
    chosen = parser.parse_args()
    packages = packages_of(chosen.lock)
    if chosen.cyclonedx:
        print(json.dumps(_bill(packages), indent=1))
        return
    print("| package | version | licence | what it is |\n|---|---|---|---|")
    for one in packages:
        print(f"| {one.name} | {one.version} | {one.licence or 'see its files'} | {one.purpose.replace('|', '/')} |")


def _bill(packages: list[Package]) -> dict[str, object]:
    components = [
        {
            "type": "library",
            "name": one.name,
            "version": one.version,
            "purl": f"pkg:pypi/{one.name.lower()}@{one.version}",
            **({"licenses": [{"license": {"name": one.licence}}]} if one.licence else {}),
        }
        for one in packages
    ]
    return {"bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1, "components": components}


if __name__ == "__main__":
    main()
