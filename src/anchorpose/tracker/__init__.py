"""The stages put together for one patient: what the room is, what a frame shows, where the body is."""
