"""The body model: linear blend skinning of the embedded body or of a user's SMPL-X file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES, PARENTS

if TYPE_CHECKING:
    from pathlib import Path

    import torch

    from physic_core.body.model import BodyModel

__all__ = ["JOINT_INDEX", "JOINT_NAMES", "PARENTS", "load_body"]


def load_body(source: str | Path = "embedded", device: torch.device | str = "cpu") -> BodyModel:
    """Load the embedded body model or a SMPL-X file.

    Args:
        source: "embedded", or the path of your own ``SMPLX_*.npz`` (layouts v1.0 and v1.1; its
            first 10 shape and 10 expression components are used,
            ``physic_core.body.files.load_smplx`` takes other numbers).
        device: where its tensors go.

    Raises:
        BodyModelError: the file does not exist, or is not an SMPL-X model.
    """
    from physic_core.body.files import load_embedded, load_smplx

    return load_embedded(device) if source == "embedded" else load_smplx(source, device)
