"""Bodies of one photo as other programs write them: which form it is by its content, and the record
of each form.

Frames, units, pivots and focal rules are those of the programs' public code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.files import matrix
from physic_core.geometry import check_rotations, rotmat_to_rotvec
from physic_core.types import BodiesInFile, FileOfPhoto
from physic_opencv.documents import MESHES, open_document

if TYPE_CHECKING:
    from physic_core.types import Float64Array


_Record = BodiesInFile

# Mean errors of joints on 3DPW (14 joints) above the default of BodiesInFile, by Table 2 of the
# report of SAM 3D Body (arXiv 2602.15989). There, SAM 3D Body, CameraHMR, PromptHMR and WHAM have
# 55 to 59 mm.
_SIGMA_M = {"4D-Humans": 0.081, "SMPLer-X": 0.077}
_VERTICES = {6890: "smpl", 10475: "smplx", 18439: "mhr"}
_BODY = 22  # joints that SMPL, SMPL-H and SMPL-X share
_JOINTS = 55
_CROP_FOCAL = 5000 / 256  # of 4D-Humans, per px of the longer side
_MULTI_HMR_FOCAL = 0.5 / math.tan(math.radians(30))
_AT_ORIGIN_M = 1.0  # a body whose middle is nearer has no translation
_PARTS = {
    "global_orient": (0, 1),
    "jaw_pose": (22, 23),
    "leye_pose": (23, 24),
    "reye_pose": (24, 25),
    "left_hand_pose": (25, 40),
    "right_hand_pose": (40, 55),
}
_NAMES = ("global_orient", "body_pose", "betas", "transl")
_POSES = {
    72: ("smpl", [*range(_BODY)]),  # and one joint in each hand
    156: ("smplh", [*range(_BODY), *range(25, _JOINTS)]),
    165: ("smplx", [*range(_JOINTS)]),
}
"""Numbers of all joints' vectors -> model, and which joints of SMPL-X they are."""
_SAM_3D_BODY: Mapping[str, tuple[int, ...]] = {
    "pred_cam_t": (3,),
    "pred_keypoints_3d": (70, 3),
    "pred_vertices": (18439, 3),
    "focal_length": (),
}
_FLAT = np.zeros((1, 10))
_CAMERA_KEYS = ("K", "intrinsics", "cam_int", "K_fullimg", "camera_matrix")


def bodies_of(file: FileOfPhoto) -> BodiesInFile | None:
    """Return the bodies of a file, or of the files of one photo in a folder; None if its form is
    not known.

    Raises:
        ValueError: the form is known and refused.
    """
    if file.path.is_dir():
        return _read_folder(file)
    document = open_document(file.path)
    for is_form, read in _FORMS:
        if is_form(document):
            return read(document, file)
    return None


def _read_folder(file: FileOfPhoto) -> BodiesInFile | None:
    """Return the bodies of all files of one photo."""
    stem = Path(file.photo).stem
    records = []
    for path in sorted(file.path.iterdir()):
        is_body = path.suffix.lower() in (*MESHES, ".npz") and path.is_file()
        named = str(_meta_of(path).get("img_path", "")) if is_body else ""
        if is_body and (path.stem.startswith(stem) or Path(named).stem == stem):
            record = bodies_of(replace(file, path=path))
            records += [] if record is None else [record]
    if not records:
        raise ValueError(f"no file in it is of {file.photo or 'the photo'}, by name or meta file")
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(record, name) for record in records])
        for name, value in vars(records[0]).items()
        if isinstance(value, np.ndarray)
    }
    return replace(records[0], **joined)


def _meta_of(path: Path) -> Mapping[str, Any]:
    """Return SMPLer-X's meta file of a body, which is beside its folder; nothing without one."""
    meta = path.parent.parent / "meta" / f"{path.stem}.json"
    document = open_document(meta) if meta.is_file() else {}
    return document if isinstance(document, Mapping) else {}


def _has_keys(*keys: str) -> Callable[[Any], bool]:
    return lambda document: isinstance(document, Mapping) and all(k in document for k in keys)


def _people_of(document: Any) -> list[Mapping[str, Any]]:
    """Return SAM 3D Body's dictionaries, in a list, or in the only array of an npz."""
    if isinstance(document, Mapping) and "pred_cam_t" not in document:
        document = [one for one in document.values() if isinstance(one, list | Mapping)]
        document = document[0] if len(document) == 1 else document
    people = [document] if isinstance(document, Mapping) else document
    is_list = isinstance(people, list) and all(isinstance(one, Mapping) for one in people)
    return [one for one in people if "pred_cam_t" in one] if is_list else []


def _array_rows(document: Mapping[str, Any], name: str, *shape: int) -> Float64Array:
    """Return an array (N, *shape) of a document, also of one person without N.

    Raises:
        ValueError: it has another number of values, or others than numbers.
    """
    values = matrix(document[name], name)
    if values.size % math.prod(shape):
        wanted = ", ".join(map(str, ("N", *shape)))
        raise ValueError(f"{name} must be ({wanted}), got {values.shape}")
    return values.reshape(-1, *shape)


def _centred(focal: Any, size: tuple[int, int], count: int) -> Float64Array:
    """Return cameras (N, 4) of one focal length, or of N, with the middle of a picture."""
    middle = (np.array(size) - 1) / 2
    focal = np.reshape(np.asarray(focal), -1)
    return np.stack([np.broadcast_to(v, count) for v in (focal, focal, *middle)], 1)


def _cameras(document: Mapping[str, Any], count: int) -> Float64Array | None:
    """Return the cameras (N, 4) of a camera matrix or of each person's; None if there is none."""
    for key in _CAMERA_KEYS:
        if key in document:
            numbers = _array_rows(document, key, 9)[:, [0, 4, 2, 5]]
            return np.broadcast_to(numbers, (count, 4))
    return None


def _record_of_sam_3d_body(document: Any, file: FileOfPhoto) -> _Record:
    from physic_networks.bodies import joints_from_mhr70

    people = _people_of(document)
    each = {
        name: np.concatenate([_array_rows(one, name, *shape) for one in people])
        for name, shape in _SAM_3D_BODY.items()
        if name in people[0]
    }
    joints, focal = each.get("pred_keypoints_3d"), each.get("focal_length")
    return _Record(
        "SAM 3D Body",
        "mhr",
        transl=each["pred_cam_t"],
        vertices=each.get("pred_vertices"),
        joints=None if joints is None else joints_from_mhr70(joints),
        camera=None if focal is None else _centred(focal, file.size, len(people)),
    )


def _frame_of_file(count: int, file: FileOfPhoto) -> int:
    """Return which of some pictures of a film is meant."""
    _check_count(count)
    if file.frame is None and count > 1:
        raise ValueError(f"it has {count} pictures of a film: set photo.bodies_frame, from 0")
    if (file.frame or 0) >= count:
        raise ValueError(f"photo.bodies_frame is {file.frame}: give 0 to {count - 1}")
    return file.frame or 0


def _check_count(count: int) -> None:
    if not count:
        raise ValueError("it states no person")


def _record_of_gvhmr(document: Any, file: FileOfPhoto) -> _Record:
    parameters = document["smpl_params_incam"]
    at = _frame_of_file(len(parameters["transl"]), file)
    values = {name: np.asarray(parameters[name])[at : at + 1] for name in _NAMES}
    if "K_fullimg" in document:
        values["K"] = np.asarray(document["K_fullimg"])[at]
    return _posed("GVHMR", values, mean_hands=True)


def _record_of_prompt_hmr(document: Any, file: FileOfPhoto) -> _Record:
    turns = np.asarray(document["rotmat"])
    values = {"global_orient": turns[:, :1], "body_pose": turns[:, 1:_BODY]}
    values |= {name: document[name] for name in ("betas", "transl")}
    record = _posed("PromptHMR", values, mean_hands=True)
    focal = math.hypot(*file.size)  # cam_int is of a padded picture
    return replace(record, camera=_centred(focal, file.size, len(turns)))


def _is_wham(document: Any) -> bool:
    people = list(document.values()) if isinstance(document, Mapping) else []
    return bool(people) and all(_has_keys("pose", "pose_world", "frame_ids")(one) for one in people)


def _record_of_wham(document: Any, file: FileOfPhoto) -> _Record:
    people = list(document.values())
    frames = [np.ravel(one["frame_ids"]) for one in people]
    frame_numbers = np.concatenate(frames)
    _check_count(len(frame_numbers))
    is_film = file.frame is not None or len(np.unique(frame_numbers)) > 1
    frame = _frame_of_file(int(frame_numbers.max()) + 1, file) if is_film else frame_numbers[0]
    is_shown = [numbers == frame for numbers in frames]
    pose, betas, transl = (
        np.concatenate(
            [_array_rows(one, name, n)[rows] for one, rows in zip(people, is_shown, strict=True)]
        )
        for name, n in (("pose", 72), ("betas", 10), ("trans", 3))
    )
    if not len(pose):
        raise ValueError(f"nobody is in the picture {frame} of the film: set photo.bodies_frame")
    return _record_of_rotvecs(
        "WHAM", pose, betas, transl, _centred(math.hypot(*file.size), file.size, len(pose))
    )


def _record_of_amass(document: Any, file: FileOfPhoto) -> _Record:
    poses = matrix(document["poses"], "poses")
    poses = poses.reshape(-1, poses.shape[-1])
    is_still = file.frame is None and len(poses) > 0 and not np.ptp(poses, axis=0).any()
    at = 0 if is_still else _frame_of_file(len(poses), file)
    shape = matrix(document.get("betas", np.zeros(10)), "betas")
    parameters = (
        poses[at : at + 1],
        shape.reshape(1, -1),
        _array_rows(document, "trans", 3)[at : at + 1],
    )
    return _record_of_rotvecs("AMASS", *parameters, _cameras(document, 1))


def _record_of_rotvecs(
    tool: str,
    poses: Float64Array,
    betas: Float64Array,
    transl: Float64Array,
    camera: Float64Array | None,
) -> _Record:
    """Return the record of the vectors (N, P) of all joints of a model."""
    if poses.shape[1] not in _POSES:
        raise ValueError(
            f"its poses have {poses.shape[1]} numbers; SMPL has 72, SMPL-H 156, SMPL-X 165"
        )
    model, joints = _POSES[poses.shape[1]]
    turns = np.zeros((len(poses), _JOINTS, 3))
    turns[:, joints] = poses.reshape(len(poses), -1, 3)[:, : len(joints)]
    return _Record(tool, model, turns, betas, transl=transl, camera=camera)


def _record_of_parameters(document: Any, file: FileOfPhoto) -> _Record:
    """Read the dictionary of SMPL, SMPL-H or SMPL-X; SMPLer-X has the camera of each beside it."""
    about = _meta_of(file.path)
    if not about:
        return _posed("parameters", document)
    camera = np.concatenate([_array_rows(about, name, 2) for name in ("focal", "princpt")], 1)
    return replace(_posed("SMPLer-X", document, mean_hands=True), camera=camera)


def _posed(tool: str, document: Mapping[str, Any], *, mean_hands: bool = False) -> _Record:
    """Return the record of parameters by the names of SMPL-X."""
    betas = matrix(document["betas"], "betas")
    betas = betas.reshape(-1, betas.shape[-1])
    count = len(betas)
    _check_count(count)
    pose = np.asarray(document["body_pose"])
    joints = pose.size // (count * (9 if pose.shape[-2:] == (3, 3) else 3))
    if joints not in (21, 23):
        raise ValueError(
            f"its body_pose has {joints} joints of {count} people; SMPL has 23, SMPL-X 21"
        )
    turns = np.zeros((count, _JOINTS, 3))
    turns[:, 1:_BODY] = _rotvecs(document, "body_pose", count, joints)[:, : _BODY - 1]
    for name in _PARTS.keys() & document.keys():
        first, last = _PARTS[name]
        turns[:, first:last] = _rotvecs(document, name, count, last - first)
    transl_name = next((name for name in ("transl", "trans") if name in document), None)
    face = document.get("expression")
    return _Record(
        tool,
        "smpl" if joints == 23 else "smplh" if _has_hands_alone(document) else "smplx",
        turns,
        betas,
        None if face is None else _array_rows(document, "expression", np.shape(face)[-1]),
        None if transl_name is None else _array_rows(document, transl_name, 3),
        camera=_cameras(document, count),
        mean_hands=mean_hands,
        is_placed=transl_name is not None,
        sigma_m=_SIGMA_M.get(tool, BodiesInFile.sigma_m),
    )


def _has_hands_alone(document: Mapping[str, Any]) -> bool:
    has_face = any(name in document for name in ("jaw_pose", "expression", "leye_pose"))
    return "left_hand_pose" in document and not has_face


def _rotvecs(document: Mapping[str, Any], name: str, count: int, joints: int) -> Float64Array:
    """Return rotation vectors (N, joints, 3) of vectors or matrices."""
    rotations = matrix(document[name], name)
    if rotations.size == 3 * count * joints:
        return rotations.reshape(count, joints, 3)
    if rotations.size != 9 * count * joints:
        raise ValueError(
            f"{name} of {joints} joints of {count} people has {rotations.size} numbers: give "
            f"vectors or matrices; PCA components of hands are not supported"
        )
    matrices = rotations.reshape(count, joints, 3, 3)
    check_rotations(matrices)
    return rotmat_to_rotvec(matrices)


def _is_mesh(document: Any) -> bool:
    if isinstance(document, np.ndarray):
        return document.ndim > 1 and bool(document.shape[-1] == 3)
    return isinstance(document, Mapping) and any(hasattr(m, "faces") for m in document.values())


def _record_of_meshes(document: Any, file: FileOfPhoto) -> _Record:
    """Read vertices of a known topology; the file's axes are told by where the bodies are."""
    vertices = _vertices(document)
    model = _VERTICES[vertices.shape[1]]
    middle = np.median(vertices[..., 2], axis=1)
    is_placed = bool((np.abs(middle) > _AT_ORIGIN_M).all())
    is_glb = file.path.suffix.lower() in (".glb", ".gltf")
    if is_glb and model == "mhr":
        raise ValueError(
            "a GLB of MHR holds the pose at rest and a skin that moves it: save SAM 3D Body's PLY, "
            "or its arrays"
        )
    tool, focal, axes = "CameraHMR", None, (1, 1, 1)
    if is_placed and (middle < 0).all():
        axes = 1, -1, -1
        tool, focal = "SAM 3D Body", _focal_of_sidecar(file.path)
        if model == "smpl":
            tool, focal = "4D-Humans", _CROP_FOCAL * max(file.size)
    elif is_placed and model == "smplx":
        tool, focal = "Multi-HMR", _MULTI_HMR_FOCAL * max(file.size)
        axes = (-1, -1, 1) if is_glb else axes
    elif is_placed:
        tool = f"{model} mesh"
    return _Record(
        tool,
        model,
        vertices=vertices * axes,
        camera=None if focal is None else _centred(focal, file.size, len(vertices)),
        is_placed=is_placed,
        sigma_m=_SIGMA_M.get(tool, BodiesInFile.sigma_m),
        notes=() if is_placed else ("the given meshes state no place: keypoints place them",),
    )


def _vertices(document: Any) -> Float64Array:
    """Return the vertices (N, V, 3) of all meshes of a known topology.

    Raises:
        ValueError: there is none.
    """
    arrays = [document]
    if isinstance(document, Mapping):
        arrays = [mesh.vertices for mesh in document.values()]
    meshes = [matrix(one, "vertices").reshape(-1, *one.shape[-2:]) for one in arrays]
    of_bodies = [mesh for mesh in meshes if mesh.shape[1] in _VERTICES]
    if not of_bodies:
        counts = ", ".join(str(mesh.shape[1]) for mesh in meshes)
        raise ValueError(f"it has {counts} vertices; SMPL has 6890, SMPL-X 10475, MHR 18439")
    return np.concatenate(of_bodies)


def _focal_of_sidecar(path: Path) -> float | None:
    """Return the focal length of the JSON file that SAM 3D Body's notebook writes beside a PLY."""
    beside = path.with_name(f"{path.stem.partition('_mesh_')[0]}_focal_length.json")
    if not beside.is_file():
        return None
    value = open_document(beside)
    focal = value["focal_length"] if isinstance(value, Mapping) else value
    return float(matrix(focal, "focal_length").ravel()[0])


_FORMS: Sequence[tuple[Callable[[Any], bool], Callable[[Any, FileOfPhoto], _Record]]] = (
    (_has_keys("smpl_params_incam"), _record_of_gvhmr),
    (_has_keys("rotmat", "betas", "transl", "cam_int"), _record_of_prompt_hmr),
    (lambda document: bool(_people_of(document)), _record_of_sam_3d_body),
    (_is_wham, _record_of_wham),
    (_has_keys("poses", "trans"), _record_of_amass),
    (_has_keys("global_orient", "body_pose", "betas"), _record_of_parameters),
    (_is_mesh, _record_of_meshes),
)
