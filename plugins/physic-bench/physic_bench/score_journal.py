"""Scores that exist: a journal in the output folder, so that a second call scores what is missing or changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from physic_bench.bodies import BodyFiles
    from physic_bench.carry import Carrier
    from physic_bench.contract import Frame, Prediction, Surface, Truth
    from physic_core.batch.journal import Journal

    Record = dict[str, Any]

SCORES = "scores"
"""Folder of the journal in the output folder."""


def score_digest(
    rules: str, frame: Frame, truth: Truth, prediction: Prediction | None, method: str, reason: str
) -> str:
    """Return a digest of everything that the records of a method on a frame depend on.

    It is of values and not of files: of the truth and the prediction after they were read.

    Args:
        rules: of :func:`rules_digest`.
        frame: of the data set.
        truth: ``frame.truth()``.
        prediction: or None.
        method: name.
        reason: why there is no prediction.
    """
    found = hashlib.sha256(rules.encode())
    given = (frame.id, frame.sequence, frame.group, frame.labels, frame.camera, method, reason)
    _add(found, (given, truth.people, truth.up, truth.camera_height, prediction))
    if truth.scene is not None:
        found.update(_scene_digest(truth.scene))
    return found.hexdigest()


def rules_digest(carrier: Carrier) -> str:
    """Return a digest of the user's body model files (by size and time), and the code of the metrics."""
    found = hashlib.sha256()
    _add(found, (_model_files(carrier.files), _code()))
    return found.hexdigest()


def known_scores(out: Path) -> dict[str, list[Record]]:
    """Return digest -> records of the journal in an output folder; lines that were cut off are ignored."""
    from physic_core.batch.journal import read_journals
    from physic_core.files.strict_json import from_json

    rows = read_journals(out / SCORES).last.values()
    return {str(row["config"]): from_json(json.loads(row["records"])) for row in rows}


def append_scores(journal: Journal, frame: str, method: str, digest: str, records: Iterable[Record]) -> None:
    """Append the records of a method on a frame."""
    from physic_core.files.strict_json import to_json

    # As text, since the journal rounds numbers.
    own = json.dumps(to_json(list(records)))
    finished = datetime.now(UTC).isoformat(timespec="microseconds")
    journal.append(
        {"id": f"{method}: {frame}", "state": "done", "config": digest, "finished": finished, "records": own}
    )


def _add(found: Any, value: Any) -> None:
    """Add a value to a digest, with its type, so that no two different values look alike."""
    found.update(type(value).__name__.encode() + b":")
    if isinstance(value, np.ndarray):
        found.update(f"{value.dtype.str}{value.shape}".encode())
        found.update(np.ascontiguousarray(value).tobytes())
    elif is_dataclass(value):
        for entry in fields(value):
            _add(found, getattr(value, entry.name))
    elif isinstance(value, Mapping):
        for key in sorted(value):
            _add(found, (key, value[key]))
    elif isinstance(value, (tuple, list)):
        found.update(f"{len(value)};".encode())
        for part in value:
            _add(found, part)
    else:
        found.update(repr(value).encode() + b";")


@lru_cache(maxsize=4)
def _scene_digest(scene: Surface) -> bytes:
    found = hashlib.sha256()
    _add(found, scene)
    return found.digest()


def _model_files(files: BodyFiles) -> list[tuple[str, int, int]]:
    listed = []
    for given in (files.smplx, files.smpl):
        paths = [] if given is None else sorted(given.iterdir()) if given.is_dir() else [given]
        listed += [(str(p.resolve()), p.stat().st_size, p.stat().st_mtime_ns) for p in paths if p.is_file()]
    return listed


@lru_cache(maxsize=1)
def _code() -> str:
    """Return a digest of this package and of the metrics of the core: other code may give other numbers."""
    import physic_core.metrics

    found = hashlib.sha256()
    for folder in (Path(__file__).parent, Path(physic_core.metrics.__file__).parent):
        for path in sorted(folder.rglob("*.py")):
            found.update(path.read_bytes())
    return found.hexdigest()
