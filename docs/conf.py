"""How the documentation is built: sphinx-build -W docs site."""

from __future__ import annotations

from anchorpose import __version__

project, author, release = "anchorpose", "the anchorpose developers", __version__
extensions = ["myst_parser", "sphinx.ext.autodoc"]
html_theme, html_title = "furo", "anchorpose"
html_show_sphinx = False
html_extra_path = ["experiment-page.html"]  # the page of the run that experiment.md tells of

autoclass_content = "both"  # of the class and of its __init__, which says what is given
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"

myst_heading_anchors = 3
