"""Join the stages for one patient: prepare the room, observe each frame, estimate the body's pose."""
