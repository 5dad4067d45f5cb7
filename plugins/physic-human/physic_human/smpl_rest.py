"""The user's SMPL file as the backends need it: where a posed body has its joints and its surface, and its T-pose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.adapters.rotations import rotvecs_of
from physic_core.adapters.smpl import SMPL_JOINTS, bodies_from_smpl
from physic_core.errors import WeightsMissingError
from physic_core.types import Mesh, RestMesh

if TYPE_CHECKING:
    from physic_core.types import Bodies, FloatArray, IntArray

__all__ = ["SmplBody", "open_smpl", "rest_of_smpl", "smpl_missing"]

_ADVICE = (
    "set smpl_file to your SMPL_NEUTRAL.npz or .pkl: register at https://smpl.is.tue.mpg.de (non-commercial) and "
    "download the model"
)


def smpl_missing(path: str) -> tuple[str, ...]:
    """What is lacking of an option ``smpl_file``, in words."""
    if not path:
        return (f"the SMPL model is not given: {_ADVICE}",)
    return () if Path(path).expanduser().is_file() else (f"there is no file {path}: {_ADVICE}",)


def open_smpl(path: str) -> SmplBody:
    """The body in a SMPL file.

    Raises:
        WeightsMissingError: it is not given, or not there.
        BodyModelError: it is no SMPL file.
    """
    if lacking := smpl_missing(path):
        raise WeightsMissingError(lacking[0])
    from physic_core.body.smpl_file import read_smpl

    return SmplBody.of(read_smpl(Path(path).expanduser()))


def rest_of_smpl(path: str) -> RestMesh | None:
    """The T-pose of a SMPL file; None where none is given.

    Raises:
        WeightsMissingError: it is not there.
        BodyModelError: it is no SMPL file.
    """
    return open_smpl(path).rest() if path else None


@dataclass(frozen=True, eq=False)
class SmplBody:
    """SMPL by linear blend skinning, float64; zero rotations are a T-pose, y up, facing +z.

    Attributes:
        template: (V, 3) metres.
        faces: (F, 3).
        shapes: (V, 3, K) shape directions.
        correctives: (V, 3, 207) pose directions.
        regressor: (24, V) joints from vertices.
        weights: (V, 24).
        parents: (24,), -1 for the pelvis.
    """

    template: FloatArray
    faces: IntArray
    shapes: FloatArray
    correctives: FloatArray
    regressor: FloatArray
    weights: FloatArray
    parents: tuple[int, ...]

    @classmethod
    def of(cls, arrays: Any) -> SmplBody:
        """From the arrays of a file."""
        parents = [int(np.int64(parent)) for parent in np.asarray(arrays["kintree_table"])[0].astype(np.int64)]
        return cls(
            np.asarray(arrays["v_template"], np.float64),
            np.asarray(arrays["f"], np.int32),
            np.asarray(arrays["shapedirs"], np.float64),
            np.asarray(arrays["posedirs"], np.float64),
            np.asarray(arrays["J_regressor"], np.float64),
            np.asarray(arrays["weights"], np.float64),
            (-1, *parents[1:]),
        )

    def rest(self) -> RestMesh:
        """The mean body in its T-pose."""
        return RestMesh("smpl", self.template, self.faces)

    def posed(self, rotvecs: FloatArray, betas: FloatArray, transl: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Vertices (N, V, 3) and joints (N, 24, 3) in metres, in the frame of the root rotation and the translation.

        Args:
            rotvecs: (N, 24, 3) radians.
            betas: (N, K), K at most that of the file.
            transl: (N, 3) metres.
        """
        from scipy.spatial.transform import Rotation

        count = len(rotvecs)
        local = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(count, SMPL_JOINTS, 3, 3)
        shaped = self.template + np.einsum("vik,nk->nvi", self.shapes[..., : betas.shape[1]], betas)
        rest = np.einsum("jv,nvi->nji", self.regressor, shaped)
        bent = (local[:, 1:] - np.eye(3)).reshape(count, -1)
        shaped = shaped + np.einsum("vip,np->nvi", self.correctives, bent)
        world = np.empty_like(local)
        joints = np.empty((count, SMPL_JOINTS, 3))
        for j, parent in enumerate(self.parents):
            if parent < 0:
                world[:, j], joints[:, j] = local[:, j], rest[:, j]
                continue
            world[:, j] = world[:, parent] @ local[:, j]
            joints[:, j] = joints[:, parent] + np.einsum("nab,nb->na", world[:, parent], rest[:, j] - rest[:, parent])
        moved = joints - np.einsum("njab,njb->nja", world, rest)
        turns = np.einsum("vj,njab->nvab", self.weights, world)
        vertices = np.einsum("nvab,nvb->nva", turns, shaped) + np.einsum("vj,nja->nva", self.weights, moved)
        return vertices + transl[:, None], joints + transl[:, None]

    def bodies(self, rotations: FloatArray, betas: FloatArray, transl: FloatArray) -> Bodies:
        """N bodies of the model "smpl" with joints and surface; rows that are not numbers stay so.

        Args:
            rotations: (N, 24, 3) vectors or (N, 24, 3, 3) matrices.
            betas: (N, K).
            transl: (N, 3) metres.
        """
        rotvecs = rotvecs_of(rotations, SMPL_JOINTS)
        sound = np.isfinite(rotvecs).all((1, 2)) & np.isfinite(betas).all(1) & np.isfinite(transl).all(1)
        vertices = np.full((len(rotvecs), *self.template.shape), np.nan, np.float32)
        joints = np.full((len(rotvecs), SMPL_JOINTS, 3), np.nan, np.float32)
        vertices[sound], joints[sound] = self.posed(
            rotvecs[sound], np.asarray(betas[sound], np.float64), np.asarray(transl[sound], np.float64)
        )
        mesh = Mesh("smpl", vertices, self.faces, self.template.astype(np.float32))
        return bodies_from_smpl(rotvecs, betas, transl, joints=joints, mesh=mesh)
