"""The user's body model files, and bodies posed by them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.damage import DamagedFrameError, as_numbers, require_finite
from physic_core.body.joints import JOINT_NAMES, ROTATION_FIELDS
from physic_core.errors import InputError
from physic_core.files.atomic import open_regular
from physic_core.files.npz import read_arrays

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.files.smpl import SmplBody
    from physic_core.body.model import BodyModel
    from physic_core.types import RestMesh

    Array = NDArray[np.float64]

SMPL_NAMES = (*JOINT_NAMES[:22], "left_hand", "right_hand")
"""Joints of SMPL."""

_SUFFIXES = (".npz", ".pkl")


@dataclass(frozen=True, eq=False)
class PosedBody:
    """A body of a user's model file.

    Attributes:
        vertices: (V, 3) m.
        joints: (J, 3) m.
        names: J.
        topology: name of the mesh.
        faces: (F, 3).
    """

    vertices: Array
    joints: Array
    names: tuple[str, ...]
    topology: str
    faces: NDArray[np.int64]


@dataclass(frozen=True)
class BodyFiles:
    """Body model files of the user.

    Attributes:
        smplx: a SMPLX_*.npz file, or a folder of SMPLX_{NEUTRAL,MALE,FEMALE}.npz; None without.
        smpl: a SMPL_*.pkl or .npz file, or a folder of SMPL_{NEUTRAL,MALE,FEMALE}; None without.
    """

    smplx: Path | None = None
    smpl: Path | None = None

    def file(self, family: str, gender: str = "neutral") -> Path:
        """Return the file of a family ("smplx", "smpl") and gender.

        Raises:
            InputError: none was given, or the folder does not hold it.
        """
        given = self.smplx if family == "smplx" else self.smpl
        if given is None:
            raise InputError(f"a {family.upper()} body needs the user's model file: give --{family} FILE or FOLDER")
        if not given.is_dir():
            return given
        names = [f"{family.upper()}_{gender.upper()}{suffix}" for suffix in _SUFFIXES]
        for name in names:
            if (given / name).is_file():
                return given / name
        raise InputError(f"{given} has no {' and '.join(names)}: a body of gender '{gender}' needs one of them")

    def has(self, family: str) -> bool:
        """Return whether a file of a family was given."""
        return (self.smplx if family == "smplx" else self.smpl) is not None

    def rest(self, topology: str) -> RestMesh | None:
        """Return the mean body of a mesh topology in the T-pose, or None if its model file was not given."""
        from physic_core.body.convert.bodies import rest_mesh_of_model

        if topology == "smpl" and self.smpl is not None:
            return _smpl(self.file("smpl")).rest
        model = self.model(topology)
        return None if model is None else rest_mesh_of_model(model)

    def model(self, topology: str) -> BodyModel | None:
        """Return the body model of a mesh topology, or None if the core poses no such body or its file is missing."""
        if topology == "physic-embedded-1":
            return _model("embedded")
        return _model(str(self.file("smplx"))) if topology == "smplx" and self.smplx is not None else None

    def regressed_joints(
        self, vertices: Array, topology: str, gender: str = "neutral"
    ) -> tuple[Array, tuple[str, ...]] | None:
        """Return joints (J, 3) and their names by the joint regressor on a posed mesh; None without the model file.

        The regressor is made for the T-pose: on a posed mesh it is an approximation.
        """
        if topology not in ("smplx", "smpl") or not self.has(topology):
            return None
        names = tuple(JOINT_NAMES) if topology == "smplx" else SMPL_NAMES
        return _regressor(topology, self.file(topology, gender)) @ vertices, names

    def smplx_body(self, parameters: Mapping[str, Any], gender: str = "neutral") -> PosedBody:
        """Pose SMPL-X.

        Args:
            parameters: names as of SMPL-X; rotation vectors, or (J, 3, 3) rotations; hands may be 6 to 24 principal
                components, of which the mean hand pose of the file is the origin. What is missing is zero.
            gender: of the model file.

        Raises:
            InputError: a model file is missing.
            DamagedFrameError: a parameter is not finite, or has another size.
        """
        import torch

        path = self.file("smplx", gender)
        model = _model(str(path))
        joined = np.concatenate(
            [_pose(parameters, name, count, path) for name, count in ROTATION_FIELDS],
        )[None]
        betas, expression = (_shape_of(parameters, name, count) for name, count in (("betas", 10), ("expression", 10)))
        transl = _translation(parameters)
        with torch.no_grad():
            given = (torch.from_numpy(a.astype(np.float32)) for a in (joined, betas, transl, expression))
            out = model(*given)
        return PosedBody(
            out.vertices[0].double().numpy(),
            out.joints[0].double().numpy(),
            tuple(JOINT_NAMES),
            "smplx",
            model.faces.numpy(),
        )

    def smpl_body(self, parameters: Mapping[str, Any]) -> PosedBody:
        """Pose SMPL: ``global_orient``, ``body_pose`` (23 joints), ``betas``, ``transl``, as in :meth:`smplx_body`."""
        body = _smpl(self.file("smpl"))
        rotations = np.concatenate(
            [
                rotations_of(parameters.get(name), count, name)
                for name, count in (("global_orient", 1), ("body_pose", 23))
            ]
        )[None]
        betas, transl = _shape_of(parameters, "betas", 10), _translation(parameters)
        return PosedBody(
            body.vertices(rotations, betas, transl)[0],
            body.smpl_joints(rotations, betas, transl)[0],
            SMPL_NAMES,
            "smpl",
            body.faces,
        )


def rotations_of(given: Any, count: int, name: str) -> Array:
    """Return rotation matrices (count, 3, 3) of rotation vectors, or of rotation matrices, row by row.

    Raises:
        DamagedFrameError: the size fits neither, or matrices are not rotations.
    """
    from physic_core.body.rotations import rotvec_to_rotmat_numpy

    if given is None:
        return np.tile(np.eye(3), (count, 1, 1))
    values = require_finite(as_numbers(given, f"'{name}'"), f"'{name}'")
    if values.size == 3 * count:
        return rotvec_to_rotmat_numpy(values.reshape(count, 3))
    if values.size == 9 * count:
        matrices = values.reshape(count, 3, 3)
        if np.abs(matrices @ matrices.swapaxes(1, 2) - np.eye(3)).max() > 1e-3 or (np.linalg.det(matrices) < 0).any():
            raise DamagedFrameError(f"'{name}' has matrices that are not rotations")
        return matrices
    raise DamagedFrameError(
        f"'{name}' must be {count} rotation vectors or rotation matrices, {3 * count} or {9 * count} numbers, got "
        f"{values.size}"
    )


def _pose(parameters: Mapping[str, Any], name: str, count: int, path: Path) -> Array:
    given = parameters.get(name)
    if given is not None and "hand" in name and 6 <= np.size(given) <= 24:
        mean, components = _hand(str(path), name[0])
        given = mean + as_numbers(given, f"'{name}'").reshape(-1) @ components[: np.size(given)]
    return rotations_of(given, count, name)


def _shape_of(parameters: Mapping[str, Any], name: str, count: int) -> Array:
    """Return (1, count) numbers, the first of those given; zeros follow if fewer are given."""
    given = parameters.get(name)
    values = np.zeros(count) if given is None else as_numbers(given, f"'{name}'").reshape(-1)[:count]
    return require_finite(np.concatenate([values, np.zeros(count - len(values))])[None], f"'{name}'")


def _translation(parameters: Mapping[str, Any]) -> Array:
    given = parameters.get("transl")
    values = np.zeros(3) if given is None else as_numbers(given, "'transl'").reshape(-1)
    if values.size != 3:
        raise DamagedFrameError(f"'transl' must be 3 numbers, got {values.size}")
    return require_finite(values[None], "'transl'")


@lru_cache(maxsize=4)
def _hand(path: str, side: str) -> tuple[Array, Array]:
    """Return mean (45,) and principal components (45, 45) of the hand pose of a SMPL-X file."""
    try:
        with open_regular(Path(path)) as stream:
            mean, components = read_arrays(stream, (f"hands_mean{side}", f"hands_components{side}")).values()
            return mean.astype(np.float64), components.astype(np.float64)
    except Exception as error:  # of zipfile and its compressors, which have many
        raise InputError(
            f"{path} has no hands_mean{side} and hands_components{side}, which these hands need: give "
            "the official SMPL-X file"
        ) from error


@lru_cache(maxsize=2)
def _regressor(topology: str, path: Path) -> Array:
    if topology == "smpl":
        return _smpl(path).regressor
    with open_regular(path) as stream:
        return np.asarray(read_arrays(stream, ["J_regressor"])["J_regressor"], np.float64)


@lru_cache(maxsize=4)
def _model(source: str) -> BodyModel:
    from physic_core.body import load_body

    return load_body(source)


@lru_cache(maxsize=3)
def _smpl(path: Path) -> SmplBody:
    from physic_core.body.files.smpl import load_smpl

    return load_smpl(path)
