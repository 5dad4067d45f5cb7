"""Children in worlds: bodies as Anny shapes them.

A child is a shape of its own beside the shape components of the embedded body: the components come
near, and what they cannot express is a further component of each child.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["age_of", "with_children"]


@cache
def _baked() -> dict[str, FloatArray]:
    """Return the arrays of ``children.npz`` (``tools/bake_children.py``)."""
    with np.load(Path(__file__).with_name("children.npz")) as file:
        return {name: file[name] for name in ("age", "betas", "residual", "step_m", "joints")}


def with_children(model: BodyModel) -> BodyModel:
    """Return the embedded body with one more shape component for each child.

    Args:
        model: embedded body in float64.
    """
    import torch

    baked = _baked()
    skin = model.skin
    kinematics = model.kinematics
    residual = torch.from_numpy(baked["residual"].astype(np.float64) * float(baked["step_m"]))
    joints = torch.from_numpy(baked["joints"].astype(np.float64))
    return replace(
        model,
        num_betas=model.num_betas + len(residual),
        skin=replace(skin, directions=torch.cat([skin.directions, residual.permute(0, 2, 1)])),
        kinematics=replace(
            kinematics, directions=torch.cat([kinematics.directions, joints.flatten(1)])
        ),
    )


def age_of(betas: FloatArray) -> float:
    """Return the age of a body of :func:`with_children`, years; NaN for an adult."""
    own = betas[_baked()["betas"].shape[1] :]
    return float(_baked()["age"][own.argmax()]) if own.any() else np.nan
