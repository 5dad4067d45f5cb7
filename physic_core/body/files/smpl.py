"""Load SMPL from a user's file and evaluate it by linear blend skinning."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physic_core.body.files.model_file import SMPL, read_model_file
from physic_core.types import RestMesh

_Array = NDArray[np.float64]

SMPL_PARENTS = SMPL.parents
"""Parents of the 24 joints; -1 for the pelvis."""

_NUM_JOINTS, _NUM_BETAS = 24, 10


@dataclass(frozen=True, eq=False)
class SmplBody:
    """SMPL body model, float64; zero rotations are a T-pose, y up, facing +z.

    Attributes:
        template: (6890, 3) metres.
        faces: (13776, 3).
        shapedirs: (6890, 3, 10) change with one unit of each beta.
        posedirs: (6890, 3, 207) change with each number of the local rotations, less the identity.
        regressor: (24, 6890) joints from vertices.
        weights: (6890, 24) of skinning.
    """

    template: _Array
    faces: NDArray[np.int64]
    shapedirs: _Array
    posedirs: _Array
    regressor: _Array
    weights: _Array

    @property
    def rest(self) -> RestMesh:
        """Mesh of the mean body in its T-pose."""
        return RestMesh("smpl", self.template, self.faces)

    def smpl_joints(self, rotations: _Array, betas: _Array, transl: _Array | None = None) -> _Array:
        """Return posed joints (N, 24, 3), metres, for local rotations (N, 24, 3, 3), betas (N, 10), transl (N, 3)."""
        joints = self._chain(rotations, self._shaped(betas))[1]
        return joints if transl is None else joints + transl[:, None]

    def vertices(self, rotations: _Array, betas: _Array, transl: _Array | None = None) -> _Array:
        """Return posed vertices (N, 6890, 3), metres; arguments as in :meth:`smpl_joints`."""
        shaped = self._shaped(betas)
        world, joints, rest = self._chain(rotations, shaped)
        bent = (rotations[:, 1:] - np.eye(3)).reshape(len(rotations), -1)
        shaped = shaped + (bent @ self.posedirs.reshape(-1, bent.shape[1]).T).reshape(shaped.shape)
        turns = (self.weights @ world.reshape(len(world), _NUM_JOINTS, 9)).reshape(*shaped.shape, 3)
        shifts = self.weights @ (joints - (world @ rest[..., None])[..., 0])
        posed: _Array = (turns @ shaped[..., None])[..., 0] + shifts
        return posed if transl is None else posed + transl[:, None]

    def _shaped(self, betas: _Array) -> _Array:
        """Return unposed vertices (N, 6890, 3) for betas (N, 10)."""
        return self.template + (betas @ self.shapedirs.reshape(-1, self.shapedirs.shape[2]).T).reshape(
            -1, *self.template.shape
        )

    def _chain(self, rotations: _Array, shaped: _Array) -> tuple[_Array, _Array, _Array]:
        """Return world rotations (N, 24, 3, 3), posed joints (N, 24, 3) and rest joints (N, 24, 3)."""
        rest: _Array = self.regressor @ shaped
        world, joints = rotations.copy(), rest.copy()
        for joint, parent in enumerate(SMPL_PARENTS[1:], 1):
            world[:, joint] = world[:, parent] @ rotations[:, joint]
            bone = (world[:, parent] @ (rest[:, joint] - rest[:, parent])[..., None])[..., 0]
            joints[:, joint] = joints[:, parent] + bone
        return world, joints, rest


def load_smpl(path: str | Path) -> SmplBody:
    """Load the body model of a SMPL file.

    Raises:
        BodyModelError: the file does not exist, or is not a SMPL model.
    """
    arrays = read_smpl(path)
    names = ("v_template", "f", "shapedirs", "posedirs", "J_regressor", "weights")
    return SmplBody(*(arrays[name] for name in names))


def read_smpl(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read a SMPL file: array name -> array (float64, indices int64), with the first 10 shape components.

    Raises:
        BodyModelError: the file does not exist, or is not a SMPL model.
    """
    found = read_model_file(Path(path), SMPL)
    tree = found["kintree_table"].astype(np.int64)
    arrays = {name: found[name].astype(np.float64) for name in SMPL.shapes if name not in ("f", "kintree_table")}
    arrays["shapedirs"] = arrays["shapedirs"][:, :, :_NUM_BETAS]
    # The root has no parent: -1, which old files hold as 4294967295.
    tree[0, 0] = -1
    return {**arrays, "f": found["f"].astype(np.int64), "kintree_table": tree}
