"""Semantic labels of an image's pixels: what each surface is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray, UInt8Array

SURFACE_NAMES = (
    "unknown",
    "floor",
    "ground",
    "rug",
    "stairs",
    "wall",
    "ceiling",
    "window",
    "seat",
    "bed",
    "table",
    "cabinet",
    "vehicle",
    "vegetation",
    "water",
    "sky",
    "object",
    "person",
)
"""Vocabulary of :class:`SurfaceLabels`. "floor" is indoors, "ground" outdoors: road, pavement, grass, earth, sand.
"wall" includes doors, curtains, pictures and the outside of buildings. "seat" is a chair, armchair, sofa, bench or
stool. "cabinet" includes shelves and other storage. "vegetation" is trees and plants, and not grass. "object" is a
thing of no other name."""


@dataclass(frozen=True)
class SurfaceLabels(ShortRepr):
    """Semantic label of each pixel.

    Attributes:
        labels: (H, W) uint8, index into ``names``.
        names: of the labels, each one of :data:`SURFACE_NAMES`. Names that the backend never uses may be omitted.
    """

    labels: UInt8Array
    names: tuple[str, ...] = SURFACE_NAMES

    def mask(self, *names: str) -> BoolArray:
        """Return the pixels (H, W) bool with one of some names, such as ``mask("floor", "rug")``.

        Raises:
            ValueError: a name is not one of :data:`SURFACE_NAMES`.
        """
        import numpy as np

        unknown = [name for name in names if name not in SURFACE_NAMES]
        if unknown:
            raise ValueError(f"no surface is named {', '.join(map(repr, unknown))}: use {', '.join(SURFACE_NAMES)}")
        chosen = np.array([name in names for name in self.names], bool)
        return np.asarray(chosen[self.labels])
