"""Load a user's ``SMPLX_*.npz``, layouts v1.0 (20 shape columns) and v1.1 (400), without unpickling.

Only seven numeric arrays are read, not the pickled object arrays (``joint2num``, ``part2num``) of the official file.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from physic_core.body.assembly import BodyArrays, build_body_model
from physic_core.body.joints import JOINT_INDEX, NUM_JOINTS, PARENTS
from physic_core.body.model import BodyModel
from physic_core.body.model_file import check_values
from physic_core.body.npz_reader import ArrayHeader, is_archive, read_array, read_header
from physic_core.errors import BodyModelError

__all__ = ["load_smplx"]

_NUM_VERTICES, _NUM_FACES, _NUM_POSE = 10475, 20908, 9 * (NUM_JOINTS - 1)
_COLUMNS = {20: (10, 10), 400: (300, 100)}
"""Number of columns of ``shapedirs`` -> numbers of shape and of expression columns."""
_FAMILY = {6890: "an SMPL or SMPL+H", 778: "a MANO", 5023: "a FLAME"}
"""Number of vertices -> family of the body model."""
_SHAPES: dict[str, tuple[int | None, ...]] = {
    "v_template": (_NUM_VERTICES, 3),
    "f": (_NUM_FACES, 3),
    "shapedirs": (_NUM_VERTICES, 3, None),
    "posedirs": (_NUM_VERTICES, 3, _NUM_POSE),
    "J_regressor": (NUM_JOINTS, _NUM_VERTICES),
    "weights": (_NUM_VERTICES, NUM_JOINTS),
    "kintree_table": (2, NUM_JOINTS),
}
_ADVICE = "give the path of an official SMPL-X file, for example SMPLX_NEUTRAL.npz"

_Array = NDArray[Any]
_Part = TypeVar("_Part")


def load_smplx(
    path: str | Path, device: torch.device | str = "cpu", *, num_betas: int = 10, num_expression: int = 10
) -> BodyModel:
    """Load the body model of a SMPL-X file, float32.

    Its pelvis lies a little below the origin and moves with the shape; the root turns about it, and ``transl`` is added
    after that, as everywhere with SMPL-X. Hands are flat at zero: the file's mean hand pose is not used.

    Args:
        path: of an official ``.npz``.
        device: where the tensors go.
        num_betas: shape components to use, at most 10 (v1.0) or 300 (v1.1).
        num_expression: expression components to use, at most 10 (v1.0) or 100 (v1.1).

    Raises:
        BodyModelError: there is no such file, it is no SMPL-X model, or it has fewer components.
    """
    arrays = _read(Path(path))
    columns = arrays["shapedirs"].shape[2]
    num_shape, num_faces = _COLUMNS[columns]
    for name, wanted, there in (
        ("num_betas", num_betas, num_shape),
        ("num_expression", num_expression, num_faces),
    ):
        if not 0 <= wanted <= there:
            raise BodyModelError(f"{path}: {name} is {wanted}, but the file has {there}: ask for 0 to {there}")
    used = [*range(num_betas), *range(num_shape, num_shape + num_expression)]
    shapedirs = arrays["shapedirs"][:, :, used].astype(np.float32)
    regressor = arrays["J_regressor"].astype(np.float64)
    weights = arrays["weights"].astype(np.float32)
    eyes = [JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]]
    return build_body_model(
        BodyArrays(
            name="smplx",
            topology="smplx",
            template=arrays["v_template"].astype(np.float32),
            directions=np.concatenate([shapedirs, arrays["posedirs"].astype(np.float32)], 2).transpose(2, 0, 1),
            joint_template=regressor @ arrays["v_template"],
            joint_directions=np.einsum("jv,vck->kjc", regressor, shapedirs, optimize=True),
            bind_rot=None,
            weights=weights,
            faces=arrays["f"].astype(np.int64),
            num_betas=num_betas,
            num_expression=num_expression,
            outer=~np.isin(weights.argmax(1), eyes),
            info="SMPL-X model file of the user; its licence is between the user and the Max Planck Society.",
        ),
        device,
    )


def _read(path: Path) -> dict[str, _Array]:
    """Read and check the arrays of a SMPL-X file."""
    if not path.is_file():
        raise BodyModelError(f"there is no body model file {path}: {_ADVICE}, or 'embedded' for the body that ships")
    if not is_archive(path):
        raise BodyModelError(
            f"{path} is not an .npz archive (an old .pkl file, perhaps; pickles are never opened, they can run code):"
            f" {_ADVICE}"
        )
    try:
        archive = zipfile.ZipFile(path)
    except Exception as error:  # of zipfile, which has many
        raise BodyModelError(f"{path} cannot be read, the file is damaged: copy or download it again") from error
    with archive:
        there = set(archive.namelist())
        headers = {n: _read_part(path, archive, n, read_header) for n in _SHAPES if f"{n}.npy" in there}
        _check(path, headers)
        arrays = {name: _read_part(path, archive, name, read_array) for name in _SHAPES}
    check_values(path, arrays, _NUM_VERTICES, NUM_JOINTS, _ADVICE)
    parents = arrays["kintree_table"][0].astype(np.int64)
    if tuple(parents[1:]) != PARENTS[1:]:
        raise BodyModelError(f"{path}: kintree_table is not the joint tree of SMPL-X: {_ADVICE}")
    return arrays


def _check(path: Path, headers: Mapping[str, ArrayHeader]) -> None:
    """Raise BodyModelError if headers have wrong shapes or types."""
    template = headers.get("v_template")
    vertices = template.shape[0] if template is not None and template.shape else _NUM_VERTICES
    if vertices in _FAMILY:
        raise BodyModelError(f"{path} is {_FAMILY[vertices]} file ({vertices} vertices), not SMPL-X: {_ADVICE}")
    if missing := [name for name in _SHAPES if name not in headers]:
        raise BodyModelError(f"{path} lacks the arrays {', '.join(missing)}: {_ADVICE}")
    for name, shape in _SHAPES.items():
        found, dtype = headers[name].shape, headers[name].dtype
        if dtype.hasobject:
            raise BodyModelError(
                f"{path}: {name} is a pickled object, not numbers (pickles are never opened, they can run code): "
                f"{_ADVICE}"
            )
        if dtype.kind not in "fiu":
            raise BodyModelError(f"{path}: {name} holds {dtype}, not numbers: {_ADVICE}")
        if len(found) != len(shape) or any(s is not None and s != n for s, n in zip(shape, found, strict=True)):
            wanted = str(shape).replace("None", "20 or 400")
            raise BodyModelError(f"{path}: {name} must be {wanted}, got {found}: {_ADVICE}")
    columns = headers["shapedirs"].shape[2]
    if columns not in _COLUMNS:
        raise BodyModelError(f"{path}: shapedirs has {columns} columns, where SMPL-X has 20 or 400: {_ADVICE}")


def _read_part(path: Path, archive: zipfile.ZipFile, name: str, read: Callable[[zipfile.ZipFile, str], _Part]) -> _Part:
    """Read one array or header; raise BodyModelError if the file is damaged."""
    try:
        return read(archive, name)
    except Exception as error:  # of zipfile, its compressors and numpy, which have many
        raise BodyModelError(
            f"{path}: {name} cannot be read, the file is damaged: copy or download it again"
        ) from error
