"""The pinhole camera of an image, and how far its numbers can be trusted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types.arrays import FloatArray

__all__ = ["CameraTrust", "Intrinsics"]


class CameraTrust(StrEnum):
    """How far the numbers of a camera can be trusted. A more trusted camera replaces a less trusted one."""

    KNOWN = "known"
    """The user, the photo's EXIF data or a sensor states them."""

    ESTIMATED = "estimated"
    """A method estimated them from the photo, such as a network or vanishing points."""

    GUESSED = "guessed"
    """A default: neither the photo nor its file gives any evidence."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion.

    Attributes:
        fx: focal length along x, px.
        fy: focal length along y, px.
        cx: principal point along x, px (integer coordinates are pixel centres).
        cy: principal point along y, px.
        width: image width, px.
        height: image height, px.
        source: where the numbers come from, for people to read ("EXIF: 50 mm", "vanishing points"). Nothing is decided
            by this text.
        trust: a :class:`CameraTrust` or its value. The default is "estimated": whoever knows the camera, and whoever
            only guesses it, has to state so.

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
        """A camera with square pixels and the principal point in the image centre."""
        return cls(focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, width, height, source, trust)

    @property
    def known(self) -> bool:
        """Whether the user, the file or a sensor states these numbers."""
        return self.trust is CameraTrust.KNOWN

    @property
    def guessed(self) -> bool:
        """Whether these numbers are a default."""
        return self.trust is CameraTrust.GUESSED

    @property
    def matrix(self) -> FloatArray:
        """The (3, 3) float64 camera matrix, px."""
        import numpy as np

        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> Intrinsics:
        """The camera of the same image resampled to ``width`` x ``height`` px."""
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
