"""What the published code does otherwise than the paper prints; for preset "release"."""
