"""How all tests run: the same examples on every machine, and no time limit that a first compilation would break."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("same everywhere", derandomize=True, deadline=None)
settings.load_profile("same everywhere")
