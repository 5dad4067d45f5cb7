"""The layout of SMPLify-X, which PROX, HolisticMesh and MOVER write: pickled parameters and meshes per frame."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_evaluate.contract import PredictedPerson
from physic_evaluate.damage import DamagedFileError, gender_of, naming, number_array
from physic_evaluate.meshes import read_mesh, topology_of
from physic_evaluate.pickled import pickled_arrays
from physic_evaluate.readers.base import person_of_body, person_of_vertices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_evaluate.bodies import BodyFiles

    Array = NDArray[np.float64]

__all__ = ["person_of_files", "person_of_parameters"]


def person_of_files(mesh: Path | None, parameters: Path | None, bodies: BodyFiles) -> PredictedPerson:
    """Return the person of a mesh, or else of parameters; joints of the parameters if a model file is there.

    Raises:
        DamagedFileError: a file is damaged.
        InputError: only parameters are there and no SMPL-X file.
    """
    posed = None
    if parameters is not None and (mesh is None or bodies.has("smplx")):
        posed = person_of_parameters(pickled_arrays(parameters), parameters, bodies)
    if mesh is None:
        if posed is None:
            raise DamagedFileError("there is neither a mesh nor parameters")
        return posed
    vertices = read_mesh(mesh).vertices
    own = person_of_vertices(vertices, topology_of(vertices, mesh), bodies)
    if posed is None or posed.vertices is None or posed.topology != own.topology:
        return own
    # Meshes are sometimes written in another place than their parameters: the joints go with the mesh.
    shift = vertices.mean(0) - posed.vertices.mean(0)
    apart = float(np.linalg.norm(vertices - posed.vertices - shift, axis=1).mean())
    if apart > 0.02:
        return own
    return PredictedPerson(
        vertices=vertices,
        topology=own.topology,
        joints=np.asarray(posed.joints) + shift,
        joint_names=posed.joint_names,
    )


def person_of_parameters(values: dict[str, Any], path: Path, bodies: BodyFiles, row: int = 0) -> PredictedPerson:
    """Return the person of SMPLify-X's dictionary, or of one row of it.

    Raises:
        DamagedFileError: body_pose is missing: a VPoser code alone cannot be decoded here.
    """
    if "body_pose" not in values:
        code = " (a VPoser code, which it has, is not decoded)" if "pose_embedding" in values else ""
        raise DamagedFileError(f"{path} has no 'body_pose'{code}; it has: {', '.join(sorted(values))}")
    own = {name: _row(values, name, path, row) for name in values if _is_parameter(name)}
    with naming(path):
        return person_of_body(bodies.smplx_body(own, gender_of(values, path)))


def _is_parameter(name: str) -> bool:
    return name in ("betas", "expression", "transl", "global_orient") or name.endswith("_pose")


def _row(values: dict[str, Any], name: str, path: Path, row: int) -> Array:
    """Return a row of a parameter, or the one row that is there: shapes exist once for all frames."""
    found = number_array(values, name, path)
    if found.ndim < 2:
        return found
    if row and 1 < len(found) <= row:
        raise DamagedFileError(f"{path}: '{name}' has {len(found)} rows, and row {row} was expected")
    if not found.size:
        raise DamagedFileError(f"{path}: '{name}' is empty")
    own: Array = found[row if len(found) > 1 else 0]
    return own
