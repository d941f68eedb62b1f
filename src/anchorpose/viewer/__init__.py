"""``anchorpose view``: a page in the browser, served from this machine, to review results and correct them."""
