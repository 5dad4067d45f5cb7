"""Preview image and GLB files of a reconstruction."""
