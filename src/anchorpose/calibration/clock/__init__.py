"""The cameras' clocks, told from what moves."""
