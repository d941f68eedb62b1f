"""Pictures of single moments of the experiment, as the paper's Section V has them, and of its definitions.

``album.write_pictures`` makes them all; ``canvas`` is what they share; every other module is one kind of picture.
"""
