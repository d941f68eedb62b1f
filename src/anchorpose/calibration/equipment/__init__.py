"""The pose of the equipment in each camera, told from its depth picture and chi_0."""
