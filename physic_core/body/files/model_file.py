"""Read a user's SMPL, SMPL-X or MANO file, ``.npz`` or a published ``.pkl``, without running code in it.

Shapes and types are checked before memory for the data is allocated.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physic_core.body.files.array_pickle import (
    InvalidArrayError,
    PickledObject,
    UnsafePickleError,
    as_array,
    escape_unprintable,
    read_pickle,
)
from physic_core.body.joints import NUM_JOINTS, PARENTS
from physic_core.errors import BodyModelError
from physic_core.files.npz import ArrayHeader, ObjectArrayError, read_arrays, read_headers, read_names

_NAMES = {10475: "a SMPL-X", 6890: "a SMPL", 778: "a MANO", 5023: "a FLAME"}
"""Number of vertices -> family of the body model."""


@dataclass(frozen=True)
class ModelFileLayout:
    """Arrays and shapes in the files of one family of body models.

    Attributes:
        name: of the family, "SMPL".
        vertices: how many.
        faces: how many.
        parents: parent of each joint; that of the root is not compared.
        columns: numbers of shape components, the columns of ``shapedirs``, that files have.
        advice: which file to give.
        others: further arrays and their shapes.
        has_pickles: whether files may be pickles.
    """

    name: str
    vertices: int
    faces: int
    parents: tuple[int, ...]
    columns: Collection[int]
    advice: str
    others: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    has_pickles: bool = True

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.parents)

    @property
    def columns_text(self) -> str:
        """The least and the greatest of ``columns``, for messages: "10 to 300", or "20 or 400" if there are two."""
        return f"{min(self.columns)} {'or' if len(self.columns) == 2 else 'to'} {max(self.columns)}"

    @property
    def shapes(self) -> dict[str, tuple[int | None, ...]]:
        """Name of each array -> its shape; None is a number of ``columns``."""
        return {
            "v_template": (self.vertices, 3),
            "f": (self.faces, 3),
            "shapedirs": (self.vertices, 3, None),
            "posedirs": (self.vertices, 3, 9 * (self.joints - 1)),
            "J_regressor": (self.joints, self.vertices),
            "weights": (self.vertices, self.joints),
            "kintree_table": (2, self.joints),
            **self.others,
        }


SMPL = ModelFileLayout(
    "SMPL",
    6890,
    13776,
    (*PARENTS[:22], 20, 21),
    range(10, 301),
    "give the path of an official SMPL file, for example SMPL_NEUTRAL.npz or "
    "basicmodel_neutral_lbs_10_207_0_v1.1.0.pkl",
)
"""As SMPL-X up to the wrists, then one joint in each hand."""

SMPLX = ModelFileLayout(
    "SMPL-X",
    10475,
    20908,
    PARENTS[:NUM_JOINTS],
    (20, 400),
    "give the path of an official SMPL-X file, for example SMPLX_NEUTRAL.npz, or 'embedded' for the body that ships",
    has_pickles=False,
)
MANO = ModelFileLayout(
    "MANO",
    778,
    1538,
    (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14),
    range(10, 301),
    "give the path of an official MANO file, MANO_RIGHT.pkl",
    {"hands_components": (45, 45), "hands_mean": (45,)},
)


def read_model_file(path: Path, layout: ModelFileLayout) -> dict[str, NDArray[Any]]:
    """Read and check the arrays of a body model file.

    Raises:
        BodyModelError: there is no such file, it is none of this layout, or what it holds does not fit together.
    """
    if not path.is_file():
        raise BodyModelError(f"there is no body model file {path}: {layout.advice}")
    try:
        with path.open("rb") as stream:
            is_archive = stream.read(2) == b"PK"
    except OSError as error:
        raise BodyModelError(
            f"the body model file {path} cannot be read ({error.strerror}): {layout.advice}"
        ) from error
    if is_archive:
        arrays = _from_npz(path, layout)
    elif layout.has_pickles:
        arrays = _from_pickle(path, layout)
    else:
        raise BodyModelError(
            f"{path} is not an .npz archive (an old .pkl file, perhaps; pickles of {layout.name} are never opened, "
            f"they can run code): {layout.advice}"
        )
    _check_values(path, arrays, layout)
    return arrays


def _check_values(path: Path, arrays: Mapping[str, NDArray[Any]], layout: ModelFileLayout) -> None:
    """Check that arrays are finite, that indices of vertices are in range, and the tree of the joints.

    Raises:
        BodyModelError: the file at ``path`` holds others.
    """
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise BodyModelError(f"{path}: {name} holds numbers that are not finite: {layout.advice}")
    faces = arrays["f"]
    wrong = faces[(faces < 0) | (faces >= layout.vertices) | (faces != np.floor(faces))]
    if wrong.size:
        raise BodyModelError(f"{path}: f holds {wrong.flat[0]}, not an index below {layout.vertices}: {layout.advice}")
    # The root has no parent: -1, or 4294967295 in old files.
    if tuple(arrays["kintree_table"][0, 1:]) != layout.parents[1:]:
        raise BodyModelError(f"{path}: kintree_table is not the joint tree of {layout.name}: {layout.advice}")


def _check(path: Path, layout: ModelFileLayout, found: Mapping[str, ArrayHeader | NDArray[Any]]) -> None:
    """Raise BodyModelError if arrays are missing or have wrong shapes or types.

    Raises:
        BodyModelError: the file has others.
    """
    advice, template = layout.advice, found.get("v_template")
    count = template.shape[0] if template is not None and template.shape else layout.vertices
    if count in _NAMES and count != layout.vertices:
        raise BodyModelError(f"{path} is {_NAMES[count]} file ({count} vertices), not {layout.name}: {advice}")
    if missing := [name for name in layout.shapes if name not in found]:
        raise BodyModelError(f"{path} lacks the arrays {', '.join(missing)}: {advice}")
    if layout is SMPL and found["weights"].shape == (layout.vertices, 52):
        raise BodyModelError(f"{path} is a SMPL+H file (52 joints), not SMPL: {advice}")
    for name, shape in layout.shapes.items():
        array = found[name]
        if array.dtype.kind not in "fiu":
            raise BodyModelError(f"{path}: {name} holds {escape_unprintable(str(array.dtype))}, not numbers: {advice}")
        fits = len(array.shape) == len(shape)
        if not fits or any(s is not None and s != n for s, n in zip(shape, array.shape, strict=True)):
            wanted = str(shape).replace("None", layout.columns_text)
            raise BodyModelError(
                f"{path}: {name} must be {wanted}, got {escape_unprintable(str(array.shape))}: {advice}"
            )
    columns = found["shapedirs"].shape[2]
    if columns not in layout.columns:
        raise BodyModelError(
            f"{path}: shapedirs has {columns} columns, where {layout.name} has {layout.columns_text}: {advice}"
        )


def _from_npz(path: Path, layout: ModelFileLayout) -> dict[str, NDArray[Any]]:
    """Read the arrays of an ``.npz`` file."""
    try:
        with path.open("rb") as stream:
            present = read_names(stream)
            names = [name for name in layout.shapes if name in present]
            _check(path, layout, read_headers(stream, names))
            return read_arrays(stream, names)
    except ObjectArrayError as error:
        raise BodyModelError(f"{path} holds a pickled object where numbers belong: {layout.advice}") from error
    except BodyModelError:
        raise
    except Exception as error:  # of zipfile, its compressors and numpy, which have many
        raise BodyModelError(f"{path} cannot be read, the file is damaged: copy or download it again") from error


def _from_pickle(path: Path, layout: ModelFileLayout) -> dict[str, NDArray[Any]]:
    """Read the arrays of a pickle without running code."""
    try:
        found = read_pickle(path)
    except UnsafePickleError as error:
        raise BodyModelError(
            f"{path} is a pickle that asks for '{error}', which no {layout.name} file holds and which could run code: "
            f"it is not opened; {layout.advice}"
        ) from error
    except InvalidArrayError as error:
        raise BodyModelError(f"{path} {error}: {layout.advice}") from error
    except Exception as error:  # a pickle that is none can fail in any way
        raise BodyModelError(
            f"{path} is neither an .npz archive nor a pickle of {layout.name}: {layout.advice}"
        ) from error
    arrays = {}
    for name in layout.shapes:
        if isinstance(found.get(name), PickledObject):
            try:
                arrays[name] = as_array(found[name])
            except InvalidArrayError as error:
                raise BodyModelError(f"{path}: {name} {error}: {layout.advice}") from error
    _check(path, layout, arrays)
    return arrays
