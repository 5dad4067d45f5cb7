"""Pinhole camera of an image, and the trust in its intrinsics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types.arrays import FloatArray

__all__ = ["CameraTrust", "Intrinsics"]


class CameraTrust(StrEnum):
    """Reliability of camera intrinsics; a more reliable camera replaces a less reliable one."""

    KNOWN = "known"
    """Given by the user, the photo's EXIF data or a sensor."""

    ESTIMATED = "estimated"
    """Estimated from the photo, for example by a network or from vanishing points."""

    GUESSED = "guessed"
    """A default value, without information from the photo or its file."""


@dataclass(frozen=True)
class Intrinsics:
    """Intrinsics of a pinhole camera without distortion.

    Attributes:
        fx: focal length along x, px.
        fy: focal length along y, px.
        cx: principal point along x, px (integer coordinates are pixel centres).
        cy: principal point along y, px.
        width: image width, px.
        height: image height, px.
        source: origin of the numbers as text for people ("EXIF: 50 mm", "vanishing points"); no code depends on it.
        trust: a :class:`CameraTrust` or its value. State it for a known or a guessed camera.

    Raises:
        ValueError: ``trust`` is none of the three.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    source: str = "given"
    trust: CameraTrust = CameraTrust.ESTIMATED

    def __post_init__(self) -> None:
        object.__setattr__(self, "trust", CameraTrust(self.trust))

    @classmethod
    def from_focal(
        cls,
        focal_px: float,
        width: int,
        height: int,
        source: str = "given",
        trust: CameraTrust = CameraTrust.ESTIMATED,
    ) -> Intrinsics:
        """Create a camera with square pixels and the principal point in the image centre."""
        return cls(focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, width, height, source, trust)

    @property
    def known(self) -> bool:
        """Whether the intrinsics were given by the user, the file or a sensor."""
        return self.trust is CameraTrust.KNOWN

    @property
    def guessed(self) -> bool:
        """Whether the intrinsics are a default value."""
        return self.trust is CameraTrust.GUESSED

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix, (3, 3) float64, px."""
        import numpy as np

        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> Intrinsics:
        """Return the intrinsics for the same image resized to ``width`` x ``height`` px."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            width=width,
            height=height,
        )
