"""Settings of the visibility of vertices, shared by all energies."""

from __future__ import annotations

from dataclasses import dataclass

from physic_core.types.bounds import Degrees, NotNegative


@dataclass(frozen=True)
class VisibilitySettings:
    """Settings of the visibility of vertices."""

    vertex_spacing_m: NotNegative = 0.02
    """Vertices without contact are subsampled to this spacing, metres; 0 keeps all."""
    facing_deg: Degrees = 70.0
    """A vertex faces the camera if its normal is within this angle of the direction to the camera."""
    mask_tolerance: NotNegative = 0.01
    """Tolerance outside the mask for visible vertices, as a share of the person."""
    occlusion_aware: bool = True
    """Hidden vertices are excluded from penetration and regularised more."""
