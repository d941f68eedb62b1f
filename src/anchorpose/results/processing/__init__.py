"""Smoothing and gap filling: only when asked for, by a policy that is written down with what came of it."""
