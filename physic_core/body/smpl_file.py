"""Reads a user's own SMPL file, ``.npz`` or the ``.pkl`` that it is published as, without running what a pickle says.

A pickle can name any function of Python to be called. Here only arrays of numpy are made; sparse matrices and chumpy's
objects, which the published file holds, are read by stand-ins that keep their numbers; what else is named is refused.
"""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physic_core.body.joints import PARENTS
from physic_core.errors import BodyModelError
from physic_core.types import RestMesh

__all__ = ["SMPL_PARENTS", "SmplBody", "load_smpl", "read_smpl"]

Array = NDArray[np.float64]

SMPL_PARENTS: tuple[int, ...] = (*PARENTS[:22], 20, 21)
"""Parents of the 24 joints: those of SMPL-X up to the wrists, then a joint in each hand; -1 for the pelvis."""

_NUM_JOINTS, _NUM_VERTICES, _NUM_FACES, _NUM_BETAS = 24, 6890, 13776, 10
_SHAPES: dict[str, tuple[int | None, ...]] = {
    "v_template": (_NUM_VERTICES, 3),
    "f": (_NUM_FACES, 3),
    "shapedirs": (_NUM_VERTICES, 3, None),
    "posedirs": (_NUM_VERTICES, 3, 9 * (_NUM_JOINTS - 1)),
    "J_regressor": (_NUM_JOINTS, _NUM_VERTICES),
    "weights": (_NUM_VERTICES, _NUM_JOINTS),
    "kintree_table": (2, _NUM_JOINTS),
}
_FAMILY = {10475: "a SMPL-X", 778: "a MANO", 5023: "a FLAME"}
_ADVICE = (
    "give the path of an official SMPL file, for example SMPL_NEUTRAL.npz or basicmodel_neutral_lbs_10_207_0_v1.1.0.pkl"
)


@dataclass(frozen=True, eq=False)
class SmplBody:
    """SMPL by linear blend skinning, float64: zero rotations are a T-pose, y up, facing +z.

    Attributes:
        template: (6890, 3) metres.
        faces: (13776, 3).
        shapedirs: (6890, 3, 10) change with one unit of each beta.
        posedirs: (6890, 3, 207) change with each number of the local rotations, less the identity.
        regressor: (24, 6890) joints from vertices.
        weights: (6890, 24) of skinning.
    """

    template: Array
    faces: NDArray[np.int64]
    shapedirs: Array
    posedirs: Array
    regressor: Array
    weights: Array

    @property
    def rest(self) -> RestMesh:
        """The mean body in its T-pose."""
        return RestMesh("smpl", self.template, self.faces)

    def smpl_joints(self, rotations: Array, betas: Array, transl: Array | None = None) -> Array:
        """Joints (N, 24, 3) in metres of rotations (N, 24, 3, 3) against the parents, betas (N, 10), transl (N, 3)."""
        joints = self._chain(rotations, self._shaped(betas))[1]
        return joints if transl is None else joints + transl[:, None]

    def vertices(self, rotations: Array, betas: Array, transl: Array | None = None) -> Array:
        """Vertices (N, 6890, 3), metres; arguments as of :meth:`smpl_joints`."""
        shaped = self._shaped(betas)
        world, joints, rest = self._chain(rotations, shaped)
        bent = (rotations[:, 1:] - np.eye(3)).reshape(len(rotations), -1)
        shaped = shaped + (bent @ self.posedirs.reshape(-1, bent.shape[1]).T).reshape(shaped.shape)
        turns = (self.weights @ world.reshape(len(world), _NUM_JOINTS, 9)).reshape(*shaped.shape, 3)
        shifts = self.weights @ (joints - (world @ rest[..., None])[..., 0])
        posed: Array = (turns @ shaped[..., None])[..., 0] + shifts
        return posed if transl is None else posed + transl[:, None]

    def _shaped(self, betas: Array) -> Array:
        return self.template + (betas @ self.shapedirs.reshape(-1, self.shapedirs.shape[2]).T).reshape(
            -1, *self.template.shape
        )

    def _chain(self, rotations: Array, shaped: Array) -> tuple[Array, Array, Array]:
        """World rotations (N, 24, 3, 3), joints (N, 24, 3) and where they rest (N, 24, 3)."""
        rest: Array = self.regressor @ shaped
        world, joints = rotations.copy(), rest.copy()
        for joint, parent in enumerate(SMPL_PARENTS[1:], 1):
            world[:, joint] = world[:, parent] @ rotations[:, joint]
            bone = (world[:, parent] @ (rest[:, joint] - rest[:, parent])[..., None])[..., 0]
            joints[:, joint] = joints[:, parent] + bone
        return world, joints, rest


def load_smpl(path: str | Path) -> SmplBody:
    """The body in a SMPL file.

    Raises:
        BodyModelError: there is no such file, or it is no SMPL model.
    """
    arrays = read_smpl(path)
    names = ("v_template", "f", "shapedirs", "posedirs", "J_regressor", "weights")
    return SmplBody(*(arrays[name] for name in names))


def read_smpl(path: str | Path) -> dict[str, NDArray[Any]]:
    """The arrays of a SMPL file: ``v_template``, ``f``, ``shapedirs`` (the first 10), ``posedirs``, ``J_regressor``,
    ``weights``, ``kintree_table``; numbers are float64, indices int64.

    Raises:
        BodyModelError: there is no such file, or it is no SMPL model.
    """
    path = Path(path)
    if not path.is_file():
        raise BodyModelError(f"there is no body model file {path}: {_ADVICE}")
    found = _from_npz(path) if zipfile.is_zipfile(path) else _from_pickle(path)
    template = found.get("v_template")
    count = len(template) if isinstance(template, np.ndarray) and template.ndim else 0
    if count in _FAMILY:
        raise BodyModelError(f"{path} is {_FAMILY[count]} file ({count} vertices), not SMPL: {_ADVICE}")
    missing = [name for name in _SHAPES if not isinstance(found.get(name), np.ndarray)]
    if missing:
        raise BodyModelError(f"{path} lacks the arrays {', '.join(missing)}: {_ADVICE}")
    if found["weights"].shape == (_NUM_VERTICES, 52):
        raise BodyModelError(f"{path} is a SMPL+H file (52 joints), not SMPL: {_ADVICE}")
    for name, shape in _SHAPES.items():
        array = found[name]
        if array.dtype.kind not in "fiu":
            raise BodyModelError(f"{path}: {name} holds {array.dtype}, not numbers: {_ADVICE}")
        if array.ndim != len(shape) or any(s is not None and s != n for s, n in zip(shape, array.shape, strict=True)):
            wanted = str(shape).replace("None", "10 or more")
            raise BodyModelError(f"{path}: {name} must be {wanted}, got {array.shape}: {_ADVICE}")
    if found["shapedirs"].shape[2] < _NUM_BETAS:
        raise BodyModelError(
            f"{path}: shapedirs has {found['shapedirs'].shape[2]} columns, where SMPL has 10: {_ADVICE}"
        )
    tree = found["kintree_table"].astype(np.int64)
    if tuple(tree[0, 1:]) != SMPL_PARENTS[1:]:
        raise BodyModelError(f"{path}: kintree_table is not the joint tree of SMPL: {_ADVICE}")
    arrays = {name: found[name].astype(np.float64) for name in _SHAPES if name not in ("f", "kintree_table")}
    arrays["shapedirs"] = arrays["shapedirs"][:, :, :_NUM_BETAS]
    # The root has no parent: -1, which old files hold as 4294967295.
    tree[0, 0] = -1
    return {**arrays, "f": found["f"].astype(np.int64), "kintree_table": tree}


def _from_npz(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    try:
        with np.load(path, allow_pickle=False) as file:
            for name in _SHAPES:
                if name in file.files:
                    found[name] = file[name]
    except ValueError as error:  # what numpy raises for a pickled array
        raise BodyModelError(f"{path} holds a pickled object where numbers belong: {_ADVICE}") from error
    except (OSError, EOFError, zipfile.BadZipFile) as error:
        raise BodyModelError(f"{path} cannot be read, the file is damaged: copy or download it again") from error
    return found


def _from_pickle(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        try:
            found = _Careful(stream, encoding="latin1").load()
        except _RefusedError as error:
            raise BodyModelError(
                f"{path} is a pickle that asks for '{error}', which no SMPL file holds and which could run code: it is "
                f"not opened; {_ADVICE}"
            ) from error
        except Exception as error:  # a pickle that is none can fail in any way
            raise BodyModelError(f"{path} is neither an .npz archive nor a pickle of SMPL: {_ADVICE}") from error
    if not isinstance(found, dict):
        raise BodyModelError(f"{path} holds a {type(found).__name__}, not the arrays of a body: {_ADVICE}")
    return {str(name): value.dense() if isinstance(value, _StandIn) else value for name, value in found.items()}


class _RefusedError(Exception):
    """A pickle names something that is not to be made; the message is its name."""


class _StandIn:
    """Keeps the state of an object without being one."""

    def __init__(self, *_: Any) -> None:
        self.state: dict[str, Any] = {}

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, dict):
            self.state = state

    def dense(self) -> Any:
        """Its numbers as an array; itself where there are none."""
        return self


class _Sparse(_StandIn):
    """Of scipy's compressed matrices."""

    by_column = True

    def dense(self) -> Any:
        from scipy.sparse import csc_matrix, csr_matrix

        parts = [self.state.get(name) for name in ("data", "indices", "indptr")]
        shape = self.state.get("_shape", self.state.get("shape"))
        if shape is None or not all(isinstance(part, np.ndarray) for part in parts):
            return self
        return (csc_matrix if self.by_column else csr_matrix)(tuple(parts), shape=tuple(shape)).toarray()


class _SparseByRow(_Sparse):
    by_column = False


class _Chumpy(_StandIn):
    """Of chumpy's arrays: the numbers themselves, or a choice of another's."""

    def dense(self) -> Any:
        if isinstance(self.state.get("x"), np.ndarray):
            return self.state["x"]
        whole, chosen = self.state.get("a"), self.state.get("idxs")
        if isinstance(whole, _StandIn) and isinstance(chosen, np.ndarray):
            numbers = np.asarray(whole.dense()).ravel()[chosen]
            return numbers.reshape(self.state.get("preferred_shape", numbers.shape))
        return self


def _reconstructed(kind: Any, *_: Any) -> Any:
    """What old pickles make objects with: of stand-ins only."""
    if not (isinstance(kind, type) and issubclass(kind, _StandIn)):
        raise _RefusedError(f"copyreg._reconstructor of {kind!r}")
    return kind()


def _encoded(text: str, encoding: str = "latin1") -> bytes:
    """How new Pythons write bytes for old ones."""
    return text.encode(encoding)


class _Careful(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """What a pickle may name.

        Raises:
            _RefusedError: it is not one of these.
        """
        made = _MADE.get((module.replace("numpy._core", "numpy.core"), name))
        if made is not None:
            return made()
        if module.split(".")[:2] == ["scipy", "sparse"] and name in ("csc_matrix", "csr_matrix"):
            return _Sparse if name == "csc_matrix" else _SparseByRow
        if module.split(".")[0] == "chumpy":
            return _Chumpy
        raise _RefusedError(f"{module}.{name}")


def _numpys(name: str) -> Callable[[], Any]:
    def found() -> Any:
        # Where numpy keeps what its own pickles name moved in numpy 2.
        arrays = np.zeros(0).__reduce__()[0] if name == "_reconstruct" else np.float64(0).__reduce__()[0]
        return arrays

    return found


_MADE: dict[tuple[str, str], Callable[[], Any]] = {
    ("numpy", "ndarray"): lambda: np.ndarray,
    ("numpy", "dtype"): lambda: np.dtype,
    ("numpy.core.multiarray", "_reconstruct"): _numpys("_reconstruct"),
    ("numpy.core.multiarray", "scalar"): _numpys("scalar"),
    ("copy_reg", "_reconstructor"): lambda: _reconstructed,
    ("copyreg", "_reconstructor"): lambda: _reconstructed,
    ("__builtin__", "object"): lambda: object,
    ("builtins", "object"): lambda: object,
    ("_codecs", "encode"): lambda: _encoded,
}
