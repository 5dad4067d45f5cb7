"""Keypoints of one photo as a file states them."""

from __future__ import annotations

from dataclasses import dataclass

KeypointRow = tuple[int, str, float, float, float]
"""Number of the annotation, joint, x and y in px, and visibility or score."""


@dataclass(frozen=True)
class KeypointTable:
    """Keypoints of a file.

    Attributes:
        rows: all keypoints, also those that are not visible.
        scored: whether the third number of the form is always a score. In COCO it is a visibility,
            0, 1 or 2, unless any number of the file is another one.
        size: width and height in px of the image that the file states; None if it states none.
        notes: what of the file is not used, one sentence each.
    """

    rows: tuple[KeypointRow, ...]
    scored: bool
    size: tuple[int, int] | None = None
    notes: tuple[str, ...] = ()
