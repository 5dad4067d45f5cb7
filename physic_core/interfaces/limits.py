"""Bounds of all numbers that backends may return.

They are far beyond every real estimate, and within what the engine and every output file can hold. A person with a
number beyond them is treated as a person with a NaN.
"""

from __future__ import annotations

PIXELS = 1e5
"""Largest magnitude of a keypoint's coordinate, px."""

METRES = 1e4
"""Largest magnitude of a coordinate of a body, its joints or its vertices, m."""

RADIANS = 1e3
"""Largest magnitude of a component of a rotation vector, rad."""

SHAPE = 100.0
"""Largest magnitude of a shape or expression component. Its unit is a standard deviation among people."""

DEPTH_M = (1e-3, 1e5)
"""Smallest and largest median of a depth map, m. Single pixels may be beyond: of the sky, for example."""

RELATIVE_DEPTH = (1e-9, 1e9)
"""Smallest and largest median z of a relative point map."""

FOCAL_SHARE = (1e-4, 1e4)
"""Smallest and largest focal length, as shares of the long side of the image."""

PRINCIPAL_SHARE = 100.0
"""Largest distance of the principal point from the image's corner, as a share of the long side."""

SIGMA = 1e3
"""Largest standard deviation of a logarithm."""
