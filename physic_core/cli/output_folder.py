"""The output folder of a command: checked before anything is computed, and removed if left empty."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def reserve_folder(
    folder: Path, photo: str, *, overwrite: bool, beside: Sequence[str] = (), made: Sequence[Path] = ()
) -> Iterator[None]:
    """Create a folder for a result, and check that it can be written; after an error, new empty folders are deleted.

    Args:
        folder: of the result.
        photo: digests of its photo, or of all photos; "" if the photo cannot be read, which the run reports.
        overwrite: whether the result of another photo may be replaced.
        beside: names of files that only this command adds to a result.
        made: folders that were created for this command, the first one above the others.

    Raises:
        OutputError: the folder cannot be written, or user data would be lost.
    """
    from physic_core.files.atomic import check_writable
    from physic_core.io.result_folder import FILES, Replaced, check_overwrite

    parts = [*reversed(folder.absolute().parents), folder.absolute()]
    new = [*made, *(part for part in parts if not os.path.exists(part))]  # Path.exists raises PermissionError
    try:
        if photo:
            check_overwrite(folder, Replaced(photo, overwrite), [*FILES, *beside])
        check_writable(folder)
        yield
    except BaseException:
        for created in reversed(new):
            with suppress(OSError):  # it is not empty
                created.rmdir()
        raise
