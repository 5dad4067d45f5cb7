"""People whom the user chose in a photo by points, boxes or masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray


@dataclass(frozen=True)
class PeoplePrompt(ShortRepr):
    """The people whom the user chose in a photo, one for each point, box and mask.

    Results are in the order of the prompts: points, then boxes, then masks.

    Attributes:
        points: x, y px of a pixel on each person.
        boxes: x0, y0, x1, y1 px around each person, half open like a slice.
        masks: (M, H, W) bool, visible pixels of each person; masks do not overlap. Or None.
    """

    points: tuple[tuple[float, float], ...] = ()
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    masks: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.points) + len(self.boxes) + (0 if self.masks is None else len(self.masks))

    def describe(self, index: int) -> str:
        """Return the number and the px of a prompt as text for messages, such as "point 1 (310, 42)"."""
        if index < len(self.points):
            return f"point {index + 1} ({', '.join(f'{v:.0f}' for v in self.points[index])})"
        index -= len(self.points)
        if index < len(self.boxes):
            return f"box {index + 1} ({', '.join(f'{v:.0f}' for v in self.boxes[index])})"
        return f"mask {index - len(self.boxes) + 1}"
