"""``anchorpose view``: a page in the browser, served from this machine, to look at results and correct them."""
