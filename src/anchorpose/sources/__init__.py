"""Recordings as recorders write them, each format read by a module of its own."""
