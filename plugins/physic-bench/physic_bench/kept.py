"""Results of single photos and worlds in files, so that an interrupted run continues."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from physic_core.files.text import to_json


def kept(
    path: Path | None, make: Callable[[], Any], keep: Callable[[Any], bool] = lambda value: True
) -> Any:
    """Return the result in a file of an earlier run, or make it and write the file.

    Args:
        path: of a .json file, which holds JSON values of seven digits, or a pickle of the
            benchmark's own folder; None keeps nothing.
        make: makes the result.
        keep: whether a result is written.
    """
    is_json = path is None or path.suffix == ".json"
    if path is not None:
        with suppress(OSError, ValueError):
            return (
                json.loads(path.read_text(encoding="utf-8"))
                if is_json
                else pickle.loads(path.read_bytes())
            )
    made = to_json(make(), digits=7) if is_json else make()
    if path is not None and keep(made):
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f"{path.name}.part")
        part.write_bytes(json.dumps(made).encode() if is_json else pickle.dumps(made))
        part.replace(path)
    return made
