"""Load a user's ``SMPLX_*.npz``, layouts v1.0 (20 shape columns) and v1.1 (400), without unpickling.

Only seven numeric arrays are read, not the pickled object arrays (``joint2num``, ``part2num``) of the official file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from physic_core.body.assembly import BodyArrays, build_body_model
from physic_core.body.files.model_file import SMPLX, read_model_file
from physic_core.body.joints import JOINT_INDEX
from physic_core.body.model import BodyModel
from physic_core.errors import BodyModelError

_COLUMNS = {20: (10, 10), 400: (300, 100)}
"""Number of columns of ``shapedirs`` -> numbers of shape and of expression columns."""


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
        BodyModelError: there is no such file, it is not an SMPL-X model, or it has fewer components.
    """
    arrays = read_model_file(Path(path), SMPLX)
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
