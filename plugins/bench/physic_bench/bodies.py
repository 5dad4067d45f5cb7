"""The user's body model files, SMPL-X bodies posed by them, and values carried between meshes over
the T-poses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.data_files import checked_numbers, read_npz
from physic_core.body import ROTATION_FIELDS
from physic_core.errors import ConfigError, InputError

if TYPE_CHECKING:
    from physic_core.body import BodyModel
    from physic_core.types import BoolArray, Float64Array, RestMesh


@dataclass(frozen=True)
class BodyFiles:
    """Body model files of the user.

    Attributes:
        smplx: a SMPLX_*.npz file, or a folder of SMPLX_{NEUTRAL,MALE,FEMALE}.npz; None without.
        smpl: a SMPL_*.pkl or .npz file, or a folder of SMPL_NEUTRAL; None without.
    """

    smplx: Path | None = None
    smpl: Path | None = None

    def file(self, family: str, gender: str = "neutral") -> Path:
        """Return the file of a family ("smplx", "smpl") and gender.

        Raises:
            ConfigError: none was given.
            InputError: the folder does not hold it.
        """
        path = self.smplx if family == "smplx" else self.smpl
        if path is None:
            raise ConfigError(
                f"a {family.upper()} body needs the user's model file: give --{family} FILE or "
                f"FOLDER"
            )
        names = [f"{family.upper()}_{gender.upper()}{suffix}" for suffix in (".npz", ".pkl")]
        file = next((path / name for name in names if (path / name).is_file()), path)
        if file.is_dir():
            raise InputError(
                f"{path} has no {' and '.join(names)}: a body of gender '{gender}' needs one of "
                f"them"
            )
        return file

    def rest_mesh(self, topology: str) -> RestMesh | None:
        """Return the mean body of a mesh topology in the T-pose, or None if its model file was not
        given.
        """
        from physic_core.body import load_smpl, rest_mesh_of_model

        if topology == "smpl" and self.smpl is not None:
            return load_smpl(self.file("smpl")).rest
        model = self.model(topology)
        return None if model is None else rest_mesh_of_model(model)

    def model(self, topology: str) -> BodyModel | None:
        """Return the body model of a mesh topology, or None if the core poses no such body or its
        file is missing.
        """
        if topology == "physic-embedded-1":
            return _model("embedded")
        return (
            _model(str(self.file("smplx")))
            if topology == "smplx" and self.smplx is not None
            else None
        )

    def pose_smplx(
        self, parameters: Mapping[str, Any], gender: str = "neutral"
    ) -> tuple[Float64Array, Float64Array]:
        """Pose SMPL-X.

        Args:
            parameters: names as of SMPL-X; rotation vectors. Hands may be 6 to 24 principal
                components, of which the mean hand pose of the file is the origin. What is missing
                is zero.
            gender: of the model file.

        Returns:
            Vertices (10475, 3) and joints (55, 3), m, of ``physic_core.body.joints.JOINT_NAMES``.

        Raises:
            InputError: a model file is missing.
            DamagedFrameError: a parameter is not finite, or has another size.
        """
        import torch

        from physic_core.geometry import rotvec_to_rotmat_numpy

        path = self.file("smplx", gender)
        model = _model(str(path))
        pose = np.concatenate(
            [
                _pose_smpl_vertices(parameters, name, 3 * count, path)
                for name, count in ROTATION_FIELDS
            ]
        )
        rotations = rotvec_to_rotmat_numpy(pose.reshape(-1, 3))
        transl = checked_numbers(parameters.get("transl", np.zeros(3)), (3,), "transl")
        inputs = (
            rotations,
            _first_ten(parameters, "betas"),
            transl,
            _first_ten(parameters, "expression"),
        )
        with torch.no_grad():
            out = model(*(torch.from_numpy(np.asarray(a, np.float32))[None] for a in inputs))
        return out.vertices[0].double().numpy(), out.joints[0].double().numpy()

    def transfer(self, values: Float64Array, source: str, target: str) -> Float64Array | None:
        """Return values (V_source, C) at the vertices of another mesh (V_target, C), or None
        if they cannot be transferred.

        A transfer needs the model files of both meshes, except that of the embedded body.
        """
        if source == target:
            return values
        transfer = _vertex_transfer(self, source, target)
        return None if transfer is None else transfer(values)

    def transfer_contact(self, contact: BoolArray, source: str, target: str) -> BoolArray | None:
        """Return contact (V_source,) at the vertices of another mesh: a vertex touches if most of
        its triangle does.
        """
        carried = self.transfer(contact.astype(np.float64)[:, None], source, target)
        return None if carried is None else carried[:, 0] >= 0.5


def _pose_smpl_vertices(
    parameters: Mapping[str, Any], name: str, size: int, path: Path
) -> Float64Array:
    """Return a rotation vector of each joint, as one array."""
    rotations = np.ravel(parameters.get(name, np.zeros(size)))
    if "hand" in name and 6 <= rotations.size <= 24:
        arrays = read_npz(path)
        side = name[0]
        lacking = [
            key for key in (f"hands_mean{side}", f"hands_components{side}") if key not in arrays
        ]
        if lacking:
            raise InputError(
                f"{path} has no {' and '.join(lacking)}, which these hands need: give the "
                f"official file"
            )
        components = checked_numbers(rotations, (-1,), name)
        rotations = (
            arrays[f"hands_mean{side}"].ravel()
            + components @ arrays[f"hands_components{side}"][: rotations.size]
        )
    return checked_numbers(rotations, (size,), name)


def _first_ten(parameters: Mapping[str, Any], name: str) -> Float64Array:
    """Return the first ten numbers of a parameter; zeros follow if it has fewer."""
    values = checked_numbers(parameters.get(name, np.zeros(10)), (-1,), name)[:10]
    return np.pad(values, (0, 10 - len(values)))


@lru_cache(maxsize=4)
def _model(source: str) -> BodyModel:
    from physic_core.body import load_body

    return load_body(source)


@lru_cache(maxsize=8)
def _vertex_transfer(
    files: BodyFiles, source: str, target: str
) -> Callable[[Float64Array], Float64Array] | None:
    """Return what carries values from one mesh to another; found once, half a second each."""
    from scipy.spatial import KDTree

    from physic_core.conversion import vertex_transfer

    rest_source = files.rest_mesh(source)
    rest_target = files.rest_mesh(target)
    if rest_source is None or rest_target is None:
        return None
    model = files.model(target)
    if model is not None:
        return vertex_transfer(rest_source, model)
    model = files.model(source)
    if model is None:
        return None
    # The target has no model here: its vertices take the values of the nearest of the source's,
    # laid onto it.
    laid = vertex_transfer(rest_target, model)(rest_target.vertices.astype(np.float64))
    nearest = KDTree(laid).query(rest_target.vertices)[1]
    return lambda values: values[nearest]
