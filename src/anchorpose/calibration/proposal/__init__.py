"""A proposal for chi_0 from pictures of the empty room."""
