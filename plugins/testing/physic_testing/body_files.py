"""Synthetic SMPL and MANO model files with random values, in the format of the published files."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

from physic_core.body import MANO, SMPL, SMPL_PARENTS, ModelFileLayout

if TYPE_CHECKING:
    from physic_core.types import AnyArray


_ROOT = 2**32 - 1
_MANO_PARENTS = (_ROOT, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14)


def mano_arrays() -> dict[str, AnyArray]:
    """Return random arrays with the names and shapes of ``MANO_RIGHT.pkl``."""
    return _random_model_arrays(MANO, _MANO_PARENTS)


def smpl_arrays() -> dict[str, AnyArray]:
    """Return random arrays with the names and shapes of ``SMPL_NEUTRAL.pkl``."""
    return _random_model_arrays(SMPL, (_ROOT, *SMPL_PARENTS[1:]))


def write_published(path: Path, arrays: dict[str, Any]) -> Path:
    """Write arrays in the published format: a Python 2 pickle with a sparse regressor and chumpy
    objects.
    """
    from scipy.sparse import csc_matrix

    module = ModuleType("chumpy.ch")
    module.Ch = _Ch  # type: ignore[attr-defined]
    published = arrays | {
        "J_regressor": csc_matrix(arrays["J_regressor"]),
        "shapedirs": _Ch(arrays["shapedirs"]),
        "J": _Ch(None),
        "bs_style": "lbs",
        "bs_type": "lrotmin",
    }
    with patch.dict(sys.modules, {"chumpy": ModuleType("chumpy"), "chumpy.ch": module}):
        path.write_bytes(pickle.dumps(published, protocol=2))
    return path


class _Ch:
    """Stand-in for the array class of chumpy in a pickle."""

    __module__ = "chumpy.ch"
    __qualname__ = "Ch"

    def __init__(self, x: AnyArray | None) -> None:
        if x is not None:
            self.x = x


def _random_model_arrays(layout: ModelFileLayout, parents: tuple[int, ...]) -> dict[str, AnyArray]:
    """Return random arrays with the shapes of a model file."""
    rng = np.random.default_rng(0)
    shapes = {
        name: tuple(10 if size is None else size for size in shape)
        for name, shape in layout.shapes.items()
    }
    arrays: dict[str, AnyArray] = {
        name: rng.standard_normal(shape) for name, shape in shapes.items()
    }
    arrays["f"] = rng.integers(0, layout.vertices, shapes["f"]).astype(np.uint32)
    arrays["J_regressor"] = np.eye(layout.joints, layout.vertices)
    arrays["weights"] = rng.dirichlet(np.ones(layout.joints), layout.vertices)
    arrays["kintree_table"] = np.array([parents, range(layout.joints)], np.uint32)
    return arrays
