"""Files that show several pictures: two or more photos with a strip between them, and tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Picture = NDArray[np.uint8]

WORDS = "cut them apart"
"""What every build says to the user of a file with several pictures."""


@dataclass(frozen=True)
class Layout:
    """How pictures lie in a file.

    Attributes:
        rows: of pictures.
        columns: of pictures.
        strip_px: between pictures.
        grey: of the strips, of 255.
        margin_px: around all.
        quality: of JPEG; None for no compression.
    """

    rows: int
    columns: int
    strip_px: int
    grey: int = 255
    margin_px: int = 0
    quality: int | None = None

    @property
    def name(self) -> str:
        """In words."""
        stored = "PNG" if self.quality is None else f"JPEG {self.quality}"
        margin = f", margin {self.margin_px}" if self.margin_px else ""
        size = f"{self.rows} x {self.columns}"
        return f"{size}, {self.strip_px} px of {self.grey}{margin}, {stored}"

    def picture(self, photos: Sequence[Picture], side: int = 640) -> Picture:
        """Return the file of some photos (H, W, 3), by turns, each cut to ``side`` px or less."""
        import cv2

        tiles = iter(photos[i % len(photos)] for i in range(self.rows * self.columns))
        height, width = side * 3 // 4, side
        step = self.strip_px
        size = (
            self.rows * (height + step) - step + 2 * self.margin_px,
            self.columns * (width + step) - step + 2 * self.margin_px,
        )
        file: Any = np.full((*size, 3), self.grey, np.uint8)
        for row in range(self.rows):
            for column in range(self.columns):
                top = self.margin_px + row * (height + step)
                left = self.margin_px + column * (width + step)
                file[top : top + height, left : left + width] = _filled(next(tiles), width, height)
        if self.quality is not None:
            flags = [cv2.IMWRITE_JPEG_QUALITY, self.quality]
            file = cv2.imdecode(cv2.imencode(".jpg", file, flags)[1], cv2.IMREAD_COLOR)
        return np.ascontiguousarray(file)


def _filled(photo: Picture, width: int, height: int) -> Any:
    """Return the middle of a photo at a size of ``width`` x ``height`` px."""
    import cv2

    scale = max(width / photo.shape[1], height / photo.shape[0])
    size = max(width, round(scale * photo.shape[1])), max(height, round(scale * photo.shape[0]))
    large = cv2.resize(photo, size, interpolation=cv2.INTER_AREA)
    top, left = (size[1] - height) // 2, (size[0] - width) // 2
    return large[top : top + height, left : left + width]


STRIPS = (
    Layout(1, 2, 8, 255, 0, 90),
    Layout(2, 1, 20, 0),
    Layout(1, 2, 3, 128),
    Layout(1, 3, 12, 255, 12, 90),
    Layout(2, 1, 40, 255, 20, 75),
    Layout(1, 2, 2, 0),
    Layout(3, 1, 6, 128, 0, 90),
    Layout(1, 2, 30, 0, 30, 90),
)
"""Pictures side by side, or one above the other."""

TILES = (
    Layout(2, 2, 10, 255, 0, 90),
    Layout(2, 2, 4, 0, 8),
    Layout(3, 3, 6, 255, 6, 90),
    Layout(2, 3, 20, 128, 0, 90),
)
"""Pictures in rows and columns."""


def says_several(answer: Any) -> bool:
    """Return whether an answer tells its user that the file shows several pictures."""
    record = answer.record
    texts = (record["error"], *(record.get("warnings") or ()), *(record.get("notes") or ()))
    return any(WORDS in text for text in texts)
