"""Serve ``anchorpose view``: a page in the browser, from this machine, to review results and correct them."""
