"""Joint angles: what each is (a module a region of the body), how far off it may be, and all of them of a table."""
