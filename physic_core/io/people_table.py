"""``people.csv``: a row for each person, of one result or of a batch."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from physic_core.files.csv_rows import write_csv
from physic_core.types.person_rows import PERSON_COLUMNS, person_rows

if TYPE_CHECKING:
    from physic_core.types import Reconstruction

PEOPLE_MARK = ",".join(PERSON_COLUMNS)
"""First line of the table, by which PhySIC recognises its own files: CSV has no comments."""


def people_csv(result: Reconstruction, photo: str) -> bytes:
    """Return the table of one result.

    Args:
        result: with any number of people.
        photo: its name.
    """
    text = io.StringIO(newline="")
    write_csv(text, list(PERSON_COLUMNS), ({"photo": photo, **row} for row in person_rows(result)))
    return text.getvalue().encode()
