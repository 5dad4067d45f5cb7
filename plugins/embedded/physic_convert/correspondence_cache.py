"""Cache of vertex correspondences between body meshes."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from physic_convert.correspondence import (
    CORRESPONDENCE_VERSION,
    Correspondence,
    find_correspondence,
)
from physic_core.cache import claimed_cache, plain_name
from physic_core.errors import OutputError
from physic_core.files import DamagedFileError, read_value, write_value

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.body import BodyModel
    from physic_core.types import RestMesh


def cached_correspondence(rest: RestMesh, model: BodyModel) -> Correspondence:
    """Compute the correspondence between two body meshes, or read it from the cache.

    Raises:
        BodyModelError: as in :func:`physic_convert.correspondence.find_correspondence`.
    """
    kept = claimed_cache("correspondences")
    path = None
    if kept is not None:
        name = f"{plain_name(rest.topology)}-{model.topology}-{_mesh_digest(rest, model)}"
        path = kept.path / f"{name}{kept.suffix}"
    correspondence = (
        None if path is None else _read_correspondence(path, model.num_vertices, len(rest.vertices))
    )
    if correspondence is None:
        correspondence = find_correspondence(rest, model)
        if path is not None:
            _write_correspondence(path, correspondence)
    return correspondence


def _mesh_digest(rest: RestMesh, model: BodyModel) -> str:
    digest = hashlib.blake2b(f"{CORRESPONDENCE_VERSION} {model.topology}".encode(), digest_size=12)
    for array in (
        rest.vertices.astype(np.float32),
        rest.faces.astype(np.int64),
        model.skin.template.numpy(),
    ):
        digest.update(str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _read_correspondence(path: Path, vertices: int, source_vertices: int) -> Correspondence | None:
    try:
        correspondence: Correspondence = read_value(path, [Correspondence], {"name": path.name})
    except (OSError, DamagedFileError):
        return None  # missing or damaged: it is computed again
    shapes = [
        correspondence.corners.shape,
        correspondence.shares.shape,
        correspondence.is_sure.shape,
    ]
    fits = (
        shapes == [(vertices, 3), (vertices, 3), (vertices,)]
        and correspondence.corners.min(initial=0) >= 0
    )
    return (
        correspondence if fits and correspondence.corners.max(initial=0) < source_vertices else None
    )


def _write_correspondence(path: Path, correspondence: Correspondence) -> None:
    """Store a map; a disk error is ignored, since the map can be computed again in seconds."""
    with suppress(OSError, OutputError):
        write_value(path, correspondence, {"name": path.name})
