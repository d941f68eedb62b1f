"""Process depth images while they are taken: read cameras, record them, and compute joints at once."""
