"""Keypoints: those that the bodies were fitted to, as the CSV that ``physic run --keypoints``
reads.
"""

from __future__ import annotations

import io

from physic_core import ExportedFiles, ExportRequest
from physic_core.files import write_csv
from physic_core.types import skeleton_named

COLUMNS = ("person", "joint", "x", "y", "confidence")


def export_keypoints(request: ExportRequest) -> ExportedFiles:
    """Return one row for each keypoint that was seen, x and y in px of the upright photo file."""
    result = request.result
    rows = []
    names = skeleton_named(result.skeleton).names
    for index, person in request.chosen():
        places = result.file_pixels(person.keypoints).round(2).tolist()
        for name, place, confidence in zip(
            names, places, person.keypoint_confidence.tolist(), strict=True
        ):
            if confidence > 0:
                rows.append(
                    dict(zip(COLUMNS, (index, name, *place, round(confidence, 3)), strict=True))
                )
    table = io.StringIO(newline="")
    write_csv(table, COLUMNS, rows)
    return ExportedFiles({f"{request.stem}{request.suffix}": table.getvalue().encode()})
