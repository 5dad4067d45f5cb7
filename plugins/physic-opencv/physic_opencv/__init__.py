"""Classical OpenCV backends: inpainting, and depth and point maps of the user's files."""
