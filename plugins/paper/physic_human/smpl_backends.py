"""The user's SMPL file: base classes of backends that need it, its T-pose, and posed bodies with
joints and mesh.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import WeightsMissingError
from physic_core.interfaces import UserFile
from physic_core.types import Mesh
from physic_human.checkout_backend import CheckoutBackend, CheckoutOptions
from physic_networks.bodies import SMPL_JOINTS, bodies_from_smpl, to_rotvecs

if TYPE_CHECKING:
    from physic_core.body import SmplBody
    from physic_core.interfaces import Requirement
    from physic_core.types import Bodies, FloatArray

_ADVICE = (
    "set smpl_file to your SMPL_NEUTRAL.npz or .pkl: register at https://smpl.is.tue.mpg.de "
    "(non-commercial) and download the model"
)


def missing_smpl(path: str) -> tuple[str, ...]:
    """Describe a missing SMPL file."""
    if not path:
        return (f"the SMPL model is not given: {_ADVICE}",)
    return (
        () if Path(os.path.expanduser(path)).is_file() else (f"there is no file {path}: {_ADVICE}",)
    )


def open_smpl(path: str) -> SmplBody:
    """Load a SMPL file.

    Raises:
        WeightsMissingError: it is not given, or not there.
        BodyModelError: it is not an SMPL file.
    """
    if lacking := missing_smpl(path):
        raise WeightsMissingError(lacking[0])
    from physic_core.body import load_smpl

    return load_smpl(Path(os.path.expanduser(path)))


def pose_smpl_bodies(
    body: SmplBody, rotations: FloatArray, betas: FloatArray, transl: FloatArray
) -> Bodies:
    """Pose the SMPL model for N people, and return joints and mesh; people with non-finite
    parameters stay NaN.

    Args:
        body: of :func:`open_smpl`.
        rotations: (N, 24, 3) vectors or (N, 24, 3, 3) matrices.
        betas: (N, 10).
        transl: (N, 3) metres.
    """
    from scipy.spatial.transform import Rotation

    count = len(betas)
    rest = body.rest
    rotvecs = to_rotvecs(rotations, SMPL_JOINTS)
    sound = (
        np.isfinite(rotvecs).all((1, 2)) & np.isfinite(betas).all(1) & np.isfinite(transl).all(1)
    )
    vertices = np.full((count, *rest.vertices.shape), np.nan, np.float32)
    joints = np.full((count, SMPL_JOINTS, 3), np.nan, np.float32)
    if sound.any():
        turns = (
            Rotation.from_rotvec(rotvecs[sound].reshape(-1, 3))
            .as_matrix()
            .reshape(-1, SMPL_JOINTS, 3, 3)
        )
        inputs = (turns, betas[sound].astype(np.float64), transl[sound].astype(np.float64))
        vertices[sound] = body.vertices(*inputs)
        joints[sound] = body.smpl_joints(*inputs)
    mesh = Mesh("smpl", vertices, rest.faces, rest.vertices.astype(np.float32))
    return bodies_from_smpl(rotvecs, betas, transl, joints=joints, mesh=mesh)


class SmplCheckoutOptions(CheckoutOptions):
    """Settings of a backend that runs a checkout and reads a SMPL file."""

    smpl_file: str


class SmplCheckoutBackend(CheckoutBackend):
    """Base class of a backend that runs a checkout and reads the file of its option
    ``smpl_file``.
    """

    options: SmplCheckoutOptions

    def missing(self) -> tuple[str, ...]:
        """Describe missing checkout, packages, weights and SMPL file."""
        return (*super().missing(), *missing_smpl(self.options.smpl_file))

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the repository, its packages, and the SMPL file."""
        here = not missing_smpl(self.options.smpl_file)
        page = "https://smpl.is.tue.mpg.de"
        file = UserFile("smpl_file", "SMPL_NEUTRAL.pkl", _ADVICE, page, is_here=here)
        return (*super().requirements(), file)
