"""What the viewer ships: the library as its authors published it, with its licence; nothing that asks the network."""

import hashlib
import posixpath
import re
from importlib import resources
from pathlib import Path

import pytest

from anchorpose.viewer.guarded_server import LIVE_PAGE, VIEWER_PAGE, load_assets

ROOT = Path(__file__).resolve().parents[2]

PUBLISHED = {  # SHA-256 of the files in the npm package three 0.180.0
    "three.module.min.js": "e2b5ee6bccd38fd6d8a2428546b83c5f2426d84b152ef82be8055556e3b40eb6",
    "three.core.min.js": "61ba0df005b05991361d040d8ff670e1aadfd0ce7aeebd1fdb0725957a8957de",
    "OrbitControls.js": "b97879c748170baadeb3fb84cea1ffdf4674e283dc06042f34e2acb95a76042c",
    "TransformControls.js": "621fb8894c0f748c2be2a6ff8a6bdd72c18a22b24ddfe21d506514544df5c84e",
}


@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_the_library_is_as_it_was_published(name: str) -> None:
    file = resources.files("anchorpose.viewer").joinpath("static/three", name)
    assert hashlib.sha256(file.read_bytes()).hexdigest() == PUBLISHED[name]


def test_the_library_has_its_licence_and_is_named() -> None:
    assert "MIT License" in resources.files("anchorpose.viewer").joinpath("static/three/LICENSE").read_text()
    assert "three.js 0.180.0" in (ROOT / "NOTICE").read_text(encoding="utf-8")


def test_our_own_files_name_no_address_and_import_only_what_is_there() -> None:
    assets = load_assets()
    own = {name: asset.content.decode() for name, asset in assets.items() if not name.startswith("three/")}
    assert {VIEWER_PAGE, LIVE_PAGE} <= set(own)
    assert [name for name, text in own.items() if re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)] == []
    imports = [
        (name, target)
        for name, text in own.items()
        for target in re.findall(r'from "([^"]+)"', text)
        if target != "three"
    ]
    assert len(imports) > 30
    for name, target in imports:
        assert posixpath.normpath(posixpath.join(posixpath.dirname(name), target)) in assets, f"{name} imports {target}"
