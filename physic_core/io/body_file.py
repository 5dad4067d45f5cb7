"""Bodies that the user gives: the project's own npz, and files of other programs, which plugins
read.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from physic_core.body.joints import NUM_JOINTS, ROTATION_FIELDS
from physic_core.discovery.plugins import absence_message, find_items, import_item
from physic_core.errors import InputError, PackageMissingError
from physic_core.files.atomic import open_regular, unreadable
from physic_core.files.npz import read_arrays, read_names, write_arrays
from physic_core.files.values import matrix
from physic_core.geometry.rotations import rotvec_to_rotmat_numpy
from physic_core.interfaces.checks import RADIANS, SHAPE, check_fields, check_limit
from physic_core.types import Bodies, BodiesInFile, BodyParameters, FileOfPhoto, Mesh, RestMesh
from physic_core.types.arrays import per_person
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from typing import IO

    from physic_core.types import Float64Array, FloatArray, Intrinsics

WRONG_FORM = (
    *(ValueError, TypeError, KeyError, AttributeError, IndexError, EOFError, ArithmeticError),
    *(zipfile.BadZipFile, zlib.error, NotImplementedError),
)
"""What a damaged file, or one of another form than it seems, leads to."""

_Float = TypeVar("_Float", bound=np.floating[Any])

_FORMAT = "physic_bodies"
_VERSION = 1
_DISTRIBUTION = "metricbody-embedded"
_PARAMETERS = tuple(field.name for field in fields(BodyParameters))
_OWN_SIGMA_M = 0.06
_OWN_DISTANCE_SIGMA = 0.05
_NAMES = {"smpl": "SMPL", "smplh": "SMPL-H", "smplx": "SMPL-X", "mhr": "MHR"}
_SHARED = 22  # joints that SMPL, SMPL-H, and SMPL-X have in common
_MODEL_FILES = {
    "smpl": "SMPL_NEUTRAL.npz or .pkl",
    "smplh": "SMPLH_NEUTRAL.npz, model.npz or .pkl",
    "smplx": "SMPLX_NEUTRAL.npz",
    "mhr": "an npz of MHR in its T-pose with vertices, meters, and faces",
}
_NOBODY = "it states no person"
_LARGEST_BODY_M = 3.0
_FARTHEST_M = 300.0
_LEAST_FOCAL, _LARGEST_FOCAL = 0.1, 1000.0  # of the longer side of the picture
_LIMITS = dict.fromkeys(("betas", "expression"), (SHAPE, "")) | dict.fromkeys(
    ("transl", "vertices"), (_FARTHEST_M, "m")
)
"""Largest magnitudes of what is not a rotation."""
_Posed = tuple["FloatArray", "FloatArray", RestMesh, BodyParameters | None]


@dataclass(frozen=True)
class GivenBodies(ShortRepr):
    """N bodies that the user gives, in the frame of their own camera, metres.

    Attributes:
        bodies: with joints or a mesh, unless of the embedded model.
        source: what states them, for messages and the result.
        camera: (N, 4) fx, fy, cx, cy px; None for that of the photo.
        is_placed: whether their place in the picture is stated.
        sigma_m: root mean square error of joints relative to the pelvis.
        distance_sigma: standard deviation of the logarithm of distance, or None.
        notes: what was left out or assumed.
    """

    bodies: Bodies
    source: str = "given"
    camera: FloatArray | None = None
    is_placed: bool = True
    sigma_m: float = _OWN_SIGMA_M
    distance_sigma: float | None = _OWN_DISTANCE_SIGMA
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.bodies.parameters)

    def moved(self, move: Callable[[FloatArray], FloatArray]) -> GivenBodies:
        """Return the same with pixels (n, 2) mapped by a function."""
        if self.camera is None:
            return self
        f, c = np.split(self.camera, 2, axis=1)
        middle = move(c)
        reach = [move(c + step)[:, k] for k, step in enumerate(np.eye(2))]
        scale = np.stack(reach, 1) - middle
        return replace(self, camera=np.concatenate([f * scale, middle], axis=1))


def write_bodies(
    stream: IO[bytes] | Path,
    parameters: BodyParameters,
    body_model: str,
    camera: Intrinsics,
    sigma_m: float = _OWN_SIGMA_M,
    distance_sigma: float = _OWN_DISTANCE_SIGMA,
) -> None:
    """Write N bodies as the npz that :func:`read_bodies` reads.

    Args:
        stream: where to.
        parameters: metres, camera frame.
        body_model: that they are for.
        camera: of the picture, px.
        sigma_m: root mean square error of joints relative to the pelvis, metres.
        distance_sigma: standard deviation of the logarithm of distance.
    """
    write_arrays(
        stream,
        {
            _FORMAT: np.array(_VERSION),
            "body_model": np.array(body_model),
            "camera": np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
            "size": np.array([camera.width, camera.height]),
            "sigma_m": np.array(sigma_m),
            "distance_sigma": np.array(distance_sigma),
            **{name: np.asarray(getattr(parameters, name)) for name in _PARAMETERS},
        },
    )


def read_bodies(file: FileOfPhoto, model_file: str | None = None) -> GivenBodies:
    """Read the bodies of one photo, in px of the upright photo file.

    Args:
        file: of this project's own format, or of a tool that docs/bodies.md names.
        model_file: the body model that parameters or vertices of SMPL, SMPL-X or MHR are for.

    Raises:
        InputError: the file cannot be read, its format is unknown, or its bodies cannot be right.
        PackageMissingError: it is of another program, and no installed plugin reads it.
        BodyModelError: the model file cannot be used.
    """
    name = f"the bodies {file.path}"
    try:
        own = _physic_arrays(file.path)
        return _bodies_of_tool(file, model_file) if own is None else _physic_bodies(own, file)
    except OSError as error:
        raise InputError(f"cannot read {name}: {unreadable(error)}") from error
    except WRONG_FORM as error:
        raise InputError(f"{name} cannot be used: {unusable_message(error)}") from error


def unusable_message(error: Exception) -> str:
    """Return in words what an error of :data:`WRONG_FORM` says of a file."""
    if isinstance(error, KeyError):
        return f"it lacks {error}"
    if isinstance(error, json.JSONDecodeError | UnicodeDecodeError | zipfile.BadZipFile):
        return f"its format is unknown, or it is damaged ({error})"
    return str(error)


def bodies_in_python(bodies: Bodies) -> GivenBodies:
    """Return bodies that are given as a record.

    Raises:
        InputError: they cannot be right.
    """
    try:
        _check_parameters(bodies.parameters)
    except ValueError as error:
        raise InputError(f"the given bodies cannot be used: {error}") from error
    return GivenBodies(bodies)


def _bodies_of_tool(file: FileOfPhoto, model_file: str | None) -> GivenBodies:
    record: BodiesInFile = read_by_plugin("physic_body_readers", "bodies", file)
    _check(record)
    if record.camera is not None:
        _check_camera(record.camera, file.size)
    return GivenBodies(
        _posed(record, model_file),
        f"{record.tool}, {file.path.name}",
        record.camera,
        record.is_placed,
        record.sigma_m,
        record.distance_sigma,
        record.notes,
    )


def read_by_plugin(hook: str, what: str, file: FileOfPhoto) -> Any:
    """Return what the first reader of a hook that knows the form of a file makes of it.

    Raises:
        ValueError: none knows it.
        PackageMissingError: there is no reader.
    """
    readers = find_items(hook)
    if not readers:
        raise PackageMissingError(
            f"{what} of other programs are read by {absence_message(_DISTRIBUTION)}"
        )
    for found in readers:
        record = import_item(found, f"reader of {what}")(file)
        if record is not None:
            return record
    raise ValueError(f"its format is unknown; docs/bodies.md lists the supported {what}")


def _physic_arrays(path: Path) -> Mapping[str, Any] | None:
    """Return the arrays of this project's npz; None for another file."""
    if path.is_dir():
        return None
    with open_regular(path) as stream:
        if stream.read(2) != b"PK":
            return None
        stream.seek(0)
        try:
            names = read_names(stream)
        except Exception:  # of zipfile: not an npz
            return None
        return read_arrays(stream) if _FORMAT in names else None


def _physic_bodies(arrays: Mapping[str, Any], file: FileOfPhoto) -> GivenBodies:
    if int(arrays[_FORMAT]) != _VERSION:
        raise ValueError(f"its format version is {arrays[_FORMAT]}; PhySIC reads {_VERSION}")
    if missing := [name for name in ("camera", "size", *_PARAMETERS) if name not in arrays]:
        raise ValueError(f"it lacks the arrays {', '.join(missing)}")
    parameters = BodyParameters(**{name: arrays[name] for name in _PARAMETERS})
    _check_parameters(parameters)
    width, height = (int(v) for v in arrays["size"])
    camera = np.tile(matrix(arrays["camera"], "camera"), (len(parameters), 1))
    _check_camera(camera, (width, height))
    given_bodies = GivenBodies(
        Bodies(parameters, str(arrays["body_model"])),
        file.path.name,
        camera,
        sigma_m=_stored_sigma(arrays, "sigma_m", _OWN_SIGMA_M),
        distance_sigma=_stored_sigma(arrays, "distance_sigma", _OWN_DISTANCE_SIGMA),
    )
    if (width, height) == file.size:
        return given_bodies
    factors = scale_of_picture((width, height), file.size)
    return given_bodies.moved(lambda pixels: (pixels + 0.5) * factors - 0.5)


def _stored_sigma(arrays: Mapping[str, Any], name: str, usual: float) -> float:
    value = float(arrays.get(name, usual))
    if not value > 0:
        raise ValueError(f"{name} must be above 0, got {value}")
    return value


def _check_parameters(parameters: BodyParameters) -> None:
    """Raise ValueError if there are no people, or no body has these numbers."""
    if not len(parameters):
        raise ValueError(_NOBODY)
    _check_values(parameters, _PARAMETERS)


def _check_values(record: BodyParameters | BodiesInFile, names: Iterable[str]) -> None:
    """Raise ValueError if arrays of a record have wrong shapes, or values that no body has."""
    wrong = check_fields(record)
    for name in names:
        if not wrong and (value := getattr(record, name)) is not None:
            wrong += check_limit(name, value, *_LIMITS.get(name, (RADIANS, "rad")))
    if wrong:
        raise ValueError(wrong[0])


def _check_camera(camera: FloatArray, size: tuple[int, int]) -> None:
    """Raise ValueError unless focal lengths of cameras (N, 4) are in px of a picture of a size."""
    for focal in camera[:, :2].ravel() / max(size):
        if not _LEAST_FOCAL < focal < _LARGEST_FOCAL:
            raise ValueError(
                f"its camera has a focal length of {focal * max(size):.4g} px, in a picture of "
                f"{size[0]} x {size[1]} px: give px of the whole picture"
            )


def scale_of_picture(stated: tuple[int, int], size: tuple[int, int]) -> FloatArray:
    """Return the factors (2,) from px of a stated size, width and height, to px of the photo.

    Raises:
        ValueError: the shapes differ by more than rounding, or the picture is turned.
    """
    if min(stated) < 1:
        raise ValueError(f"it states a picture of {stated[0]} x {stated[1]} px")
    factors = np.array(size, np.float64) / stated
    # A side that was rounded is off by half a pixel.
    if abs(factors[0] / factors[1] - 1) > 1 / min(stated) + 1 / min(size):
        raise ValueError(
            f"it is for a picture of {stated[0]} x {stated[1]} px, and the photo has {size[0]} x "
            f"{size[1]}: give that of this photo, neither cropped nor turned"
        )
    return factors


def _check(record: BodiesInFile) -> None:
    """Raise ValueError if a record contradicts itself, or has another unit."""
    counts = {name: len(value) for name, value in per_person(record)}
    if not any(counts.get(name) for name in ("rotations", "vertices", "joints")):
        raise ValueError(_NOBODY)
    if len(set(counts.values())) > 1:
        each = ", ".join(f"{name} of {count}" for name, count in counts.items())
        raise ValueError(f"it has different numbers of people: {each}")
    for points in (record.vertices, record.joints):
        if points is not None and len(points):
            if np.isinf(points).any() or np.isnan(points).all((1, 2)).any():
                raise ValueError("it has a person whose body is nowhere, or infinitely far away")
            extent = float(np.nanmedian((np.nanmax(points, 1) - np.nanmin(points, 1)).max(-1)))
            if not extent < _LARGEST_BODY_M:
                raise ValueError(
                    f"its bodies are {extent:.3g} m large: are they in centimeters or millimeters?"
                )
            if not (farthest := np.nanmax(np.abs(points))) < _FARTHEST_M:
                raise ValueError(f"its bodies are {farthest:.3g} m away")
    _check_values(record, ("rotations", *_LIMITS))


def _posed(record: BodiesInFile, model_file: str | None) -> Bodies:
    """Return the bodies of a record with joints or mesh, and with parameters if the model is
    SMPL-X.
    """
    joints, vertices = record.joints, record.vertices
    rest = parameters = None
    if record.rotations is not None:
        file = _required(model_file, "parameters", record.model)
        pose = _posed_smplx if record.model == "smplx" else _posed_smpl
        joints, vertices, rest, parameters = pose(record, _rotation_vectors(record), file)
    elif vertices is not None and (model_file is not None or joints is None):
        rest = _rest_mesh(record.model, _required(model_file, "vertices", record.model))
    count = next(len(v) for v in (joints, vertices) if v is not None)
    shift = np.zeros((count, 3)) if record.transl is None else record.transl
    return Bodies(
        replace(parameters or _zero_parameters(count), transl=_as_float32(shift)),
        record.model,
        joints=None if joints is None else _as_float32(joints + shift[:, None]),
        mesh=None if rest is None or vertices is None else _mesh(vertices + shift[:, None], rest),
    )


def _mesh(vertices: FloatArray, rest: RestMesh) -> Mesh:
    if vertices.shape[1] != len(rest.vertices):
        raise ValueError(
            f"its meshes have {vertices.shape[1]} vertices, and the model's file "
            f"{len(rest.vertices)}: set photo.bodies_model to the file of their model"
        )
    return Mesh(rest.topology, _as_float32(vertices), rest.faces, _as_float32(rest.vertices))


def _rotation_vectors(record: BodiesInFile) -> Float64Array:
    """Return the rotation vectors (N, 55, 3) of a record; joints that lack are at rest."""
    given = np.asarray(record.rotations, np.float64)
    flat = with_columns_of_zeros(given.reshape(len(given), -1), 3 * NUM_JOINTS)
    return flat.reshape(-1, NUM_JOINTS, 3)


def _posed_smpl(record: BodiesInFile, turns: Float64Array, file: str) -> _Posed:
    """Pose SMPL or SMPL-H by vectors (N, 55, 3) of SMPL-X's joints."""
    from physic_core.body.files import SMPL, SMPLH, load_smpl

    layout = SMPLH if record.model == "smplh" else SMPL
    betas = (
        np.zeros((len(turns), 0)) if record.betas is None else np.asarray(record.betas, np.float64)
    )
    model = load_smpl(file, layout, max(betas.shape[1], 10))
    joint = np.arange(layout.joints if layout is SMPLH else _SHARED)
    name = joint + 3 * (joint >= _SHARED)  # SMPL-X has jaw and eyes before the hands
    rotations = np.tile(np.eye(3), (len(turns), layout.joints, 1, 1))
    rotations[:, joint] = rotvec_to_rotmat_numpy(turns[:, name])
    arguments = (
        rotations,
        with_columns_of_zeros(betas, model.shapedirs.shape[2]),
        np.zeros((len(turns), 3)),
    )
    joints = np.full((len(turns), NUM_JOINTS, 3), np.nan)
    joints[:, name] = model.smpl_joints(*arguments)[:, joint]
    return joints, model.vertices(*arguments), model.rest, None


def _posed_smplx(record: BodiesInFile, turns: Float64Array, file: str) -> _Posed:
    """Pose SMPL-X by vectors (N, 55, 3)."""
    import torch

    from physic_core.body import rest_mesh_of_model
    from physic_core.body.bones import parameters_from_rotations
    from physic_core.body.files import load_smplx

    none = np.zeros((len(turns), 0))
    own = none if record.betas is None else record.betas
    face = none if record.expression is None else record.expression
    model = load_smplx(file, num_betas=max(own.shape[1], 10), num_expression=max(face.shape[1], 10))
    if record.mean_hands:
        turns = turns + np.pad(_mean_hands(file), ((NUM_JOINTS - 30, 0), (0, 0)))
    pose, betas, expression, still = (
        torch.from_numpy(each)
        for each in (
            rotvec_to_rotmat_numpy(turns),
            with_columns_of_zeros(own, model.num_betas),
            with_columns_of_zeros(face, model.num_expression),
            np.zeros((len(turns), 3)),
        )
    )
    posed = model.double(pose, betas, still, expression)
    parameters = parameters_from_rotations(pose, betas, expression, still)
    return posed.joints.numpy(), posed.vertices.numpy(), rest_mesh_of_model(model), parameters


def _mean_hands(model_file: str) -> Float64Array:
    """Return the mean rotation vectors (30, 3) of both hands of a SMPL-X file."""
    with open_regular(Path(model_file)) as stream:
        found = read_arrays(stream, ["hands_meanl", "hands_meanr"])
    return np.concatenate([found[f"hands_mean{side}"].reshape(15, 3) for side in "lr"])


def _rest_mesh(name: str, file: str) -> RestMesh:
    """Return the T-pose of a known topology."""
    from physic_core.body import rest_mesh_of_model
    from physic_core.body.files import load_smpl, load_smplx

    if name == "smplx":
        return rest_mesh_of_model(load_smplx(file))
    if name != "mhr":
        return load_smpl(file).rest
    with open_regular(Path(file)) as stream:
        own = read_arrays(stream, ["vertices", "faces"])
    return RestMesh("mhr", own["vertices"], own["faces"].astype(np.int64))


def _required(model_file: str | None, what: str, model: str) -> str:
    if model_file is not None:
        return model_file
    raise ValueError(
        f"it has {what} of {_NAMES[model]}, whose joints and shape are in the model's file: set "
        f"photo.bodies_model to {_MODEL_FILES[model]}"
    )


def with_columns_of_zeros(values: NDArray[_Float], width: int) -> NDArray[_Float]:
    """Return the first columns of values (N, K), with zeros for columns that lack."""
    full: NDArray[_Float] = np.zeros((len(values), width), values.dtype)
    full[:, : values.shape[1]] = values[:, :width]
    return full


def _zero_parameters(count: int) -> BodyParameters:
    """Return N bodies of zeros, of a model that others than this program pose."""
    widths = {name: 3 * n for name, n in ROTATION_FIELDS} | {"betas": 0, "expression": 0}
    return BodyParameters(
        **{name: np.zeros((count, widths.get(name, 3)), np.float32) for name in _PARAMETERS}
    )


def _as_float32(values: Any) -> FloatArray:
    return np.asarray(values, np.float32)
