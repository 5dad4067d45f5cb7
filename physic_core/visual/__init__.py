"""Pictures and meshes of a reconstruction: the preview, renderings and GLB files."""
