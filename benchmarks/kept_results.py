"""Results of single photos in a folder, so that a second run of a benchmark does not compute them again."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any


def kept(path: Path, make: Any) -> Any:
    """Return the result of a single photo, from a file of an earlier run if there is one."""
    if path.is_file():
        return pickle.loads(path.read_bytes())  # of this script's own folder
    made = make()
    path.with_suffix(".tmp").write_bytes(pickle.dumps(made))
    path.with_suffix(".tmp").rename(path)
    return made
