"""Images and meshes of a reconstruction: preview, renderings and GLB files."""
