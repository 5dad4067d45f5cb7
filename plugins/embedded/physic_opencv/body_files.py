"""Bodies of one photo as other programs write them: which form it is by its content, and the record
of each form.

Frames, units, pivots and focal rules are those of the programs' public code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physic_core.files import matrix
from physic_core.geometry import check_rotations, rotmat_to_rotvec
from physic_core.types import BodiesInFile, FileOfPhoto
from physic_opencv.documents import MESHES, open_document

_Array = NDArray[np.float64]
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
_HANDS = {"left_hand_pose": 45, "right_hand_pose": 45}
_AMASS = {
    72: {"global_orient": 3, "body_pose": 69},
    156: {"global_orient": 3, "body_pose": 63, **_HANDS},
    165: {"global_orient": 3, "body_pose": 63, "jaw_pose": 3, "leye_pose": 3, "reye_pose": 3}
    | _HANDS,
}
_CAMERA_KEYS = ("K", "intrinsics", "cam_int", "K_fullimg", "camera_matrix")


def bodies_of(file: FileOfPhoto) -> BodiesInFile | None:
    """Return the bodies of a file, or of the files of one photo in a folder; None if its form is
    not known.

    Raises:
        ValueError: the form is known and refused.
    """
    if file.path.is_dir():
        return _of_folder(file)
    document = open_document(file.path)
    for is_form, read in _FORMS:
        if is_form(document):
            return read(document, file)
    return None


def _of_folder(file: FileOfPhoto) -> BodiesInFile | None:
    """Return the bodies of all files of one photo."""
    stem = Path(file.photo).stem
    records = []
    for path in sorted(file.path.iterdir()):
        is_body = path.suffix.lower() in (*MESHES, ".npz") and path.is_file()
        if is_body and (path.stem.startswith(stem) or _photo_of_meta(path) == stem):
            record = bodies_of(replace(file, path=path))
            records += [] if record is None else [record]
    if not records:
        raise ValueError(f"no file in it is of {file.photo or 'the photo'}, by name or meta file")
    joined: dict[str, Any] = {}
    for one in fields(BodiesInFile):
        values = [getattr(record, one.name) for record in records]
        if isinstance(values[0], np.ndarray):
            joined[one.name] = np.concatenate(values)
    return replace(records[0], **joined)


def _has(*keys: str) -> Callable[[Any], bool]:
    return lambda document: isinstance(document, Mapping) and all(k in document for k in keys)


def _people_of(document: Any) -> list[Mapping[str, Any]]:
    """Return SAM 3D Body's dictionaries, in a list, or in the only array of an npz."""
    if isinstance(document, Mapping) and "pred_cam_t" not in document:
        document = [one for one in document.values() if isinstance(one, list | Mapping)]
        document = document[0] if len(document) == 1 else document
    people = [document] if isinstance(document, Mapping) else document
    is_list = isinstance(people, list) and all(isinstance(one, Mapping) for one in people)
    return [one for one in people if "pred_cam_t" in one] if is_list else []


def _rows(values: Any, *shape: int) -> _Array:
    """Return an array (N, *shape), also of one person without N."""
    return matrix(values, "a body's array").reshape(-1, *shape)


def _centred(focal: Any, size: tuple[int, int], count: int) -> _Array:
    """Return cameras (N, 4) of one focal length, or of N, with the middle of a picture."""
    focal = np.broadcast_to(matrix(focal, "focal_length").reshape(-1), (count,))
    middle = np.broadcast_to((np.array(size) - 1) / 2, (count, 2))
    return np.concatenate([np.stack([focal, focal], 1), middle], 1)


def _cameras(document: Mapping[str, Any], count: int) -> _Array | None:
    """Return the cameras (N, 4) of a camera matrix or of each person's; None if there is none."""
    for key in _CAMERA_KEYS:
        if key in document:
            matrix = np.broadcast_to(_rows(document[key], 3, 3), (count, 3, 3))
            return np.stack([matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 0, 2], matrix[:, 1, 2]], 1)
    return None


def _sam_3d_body(document: Any, file: FileOfPhoto) -> _Record:
    from physic_networks.bodies import joints_from_mhr70

    people = _people_of(document)
    each = {
        name: np.concatenate([_rows(one[name], *shape) for one in people])
        for name, shape in (
            ("pred_cam_t", (3,)),
            ("pred_keypoints_3d", (70, 3)),
            ("pred_vertices", (18439, 3)),
            ("bbox", (4,)),
            ("focal_length", ()),
        )
        if name in people[0]
    }
    place = each["pred_cam_t"]
    joints = each.get("pred_keypoints_3d")
    camera = None
    if "focal_length" in each:
        camera = _centred(each["focal_length"], file.size, len(place))
    return _Record(
        "SAM 3D Body",
        "mhr",
        transl=place,
        vertices=each.get("pred_vertices"),
        joints=None if joints is None else joints_from_mhr70(joints),
        camera=camera,
        boxes=each.get("bbox"),
    )


def _frame(count: int, file: FileOfPhoto) -> int:
    """Return which of some pictures of a film is meant."""
    if file.frame is None and count > 1:
        raise ValueError(f"it has {count} pictures of a film: set photo.bodies_frame, from 0")
    if (file.frame or 0) >= count:
        raise ValueError(f"photo.bodies_frame is {file.frame}, and it has {count} pictures")
    return file.frame or 0


def _chosen(values: Mapping[str, Any], at: int, **names: str) -> dict[str, Any]:
    """Return one row of arrays, by new name -> name in the file."""
    return {new: np.asarray(values[old])[at : at + 1] for new, old in names.items()}


def _gvhmr(document: Any, file: FileOfPhoto) -> _Record:
    given = document["smpl_params_incam"]
    at = _frame(len(given["transl"]), file)
    values = _chosen(given, at, **{name: name for name in _NAMES})
    camera = _chosen(document, at, K="K_fullimg") if "K_fullimg" in document else {}
    return _posed("GVHMR", values | camera, mean_hands=True)


def _prompt_hmr(document: Any, file: FileOfPhoto) -> _Record:
    turns = np.asarray(document["rotmat"])
    values = {"global_orient": turns[:, :1], "body_pose": turns[:, 1:_BODY]}
    values |= {name: document[name] for name in ("betas", "transl")}
    record = _posed("PromptHMR", values, mean_hands=True)
    focal = math.hypot(*file.size)  # cam_int is of a padded picture
    return replace(record, camera=_centred(focal, file.size, len(turns)))


def _is_wham(document: Any) -> bool:
    people = list(document.values()) if isinstance(document, Mapping) else []
    return bool(people) and all(_has("pose", "pose_world", "frame_ids")(one) for one in people)


def _wham(document: Any, file: FileOfPhoto) -> _Record:
    shown = np.concatenate([np.ravel(one["frame_ids"]) for one in document.values()])
    is_film = file.frame is not None or len(np.unique(shown)) > 1
    at = _frame(int(shown.max()) + 1, file) if is_film else shown[0]
    rows = [
        _chosen(one, int(row), pose="pose", betas="betas", transl="trans")
        for one in document.values()
        for row in np.flatnonzero(np.ravel(one["frame_ids"]) == at)[:1]
    ]
    if not rows:
        raise ValueError(f"nobody is in the picture {at} of the film: set photo.bodies_frame")
    values = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    values |= {"global_orient": values["pose"][:, :3], "body_pose": values["pose"][:, 3:]}
    camera = _centred(math.hypot(*file.size), file.size, len(rows))
    return replace(_posed("WHAM", values), camera=camera)


def _amass(document: Any, file: FileOfPhoto) -> _Record:
    poses = matrix(document["poses"], "poses")
    poses = poses.reshape(-1, poses.shape[-1])
    if poses.shape[1] not in _AMASS:
        raise ValueError(
            f"its poses have {poses.shape[1]} numbers; SMPL has 72, SMPL-H 156, SMPL-X 165"
        )
    is_still = file.frame is None and not np.ptp(poses, axis=0).any()
    at = 0 if is_still else _frame(len(poses), file)
    ends = np.cumsum([0, *_AMASS[poses.shape[1]].values()])
    names = _AMASS[poses.shape[1]]
    parts = {n: poses[at : at + 1, a:b] for n, a, b in zip(names, ends, ends[1:], strict=False)}
    betas = np.reshape(document.get("betas", np.zeros(10)), (1, -1))
    cameras = {key: document[key] for key in _CAMERA_KEYS if key in document}
    place = {"transl": np.reshape(document["trans"], (-1, 3))[at : at + 1]}
    return _posed("AMASS", parts | cameras | place | {"betas": betas})


def _photo_of_meta(path: Path) -> str:
    """Return the stem of the photo that SMPLer-X's meta file of a body names; "" without one."""
    meta = path.parent.parent / "meta" / f"{path.stem}.json"
    return Path(str(open_document(meta).get("img_path", ""))).stem if meta.is_file() else ""


def _parameters(document: Any, file: FileOfPhoto) -> _Record:
    """Read the dictionary of SMPL, SMPL-H or SMPL-X; SMPLer-X has the camera of each beside it."""
    meta = file.path.parent.parent / "meta" / f"{file.path.stem}.json"
    if not meta.is_file():
        return _posed("parameters", document)
    about = open_document(meta)
    record = _posed("SMPLer-X", document, mean_hands=True)
    return replace(record, camera=_rows([*about["focal"], *about["princpt"]], 4))


def _posed(tool: str, document: Mapping[str, Any], *, mean_hands: bool = False) -> _Record:
    """Return the record of parameters by the names of SMPL-X."""
    betas = matrix(document["betas"], "betas")
    count = 1 if betas.ndim == 1 else len(betas)
    turns = np.zeros((count, _JOINTS, 3))
    given = matrix(document["body_pose"], "body_pose")
    joints = given.size // (count * (9 if given.shape[-2:] == (3, 3) else 3))
    if joints not in (21, 23):
        raise ValueError(
            f"its body_pose has {joints} joints of {count} people; SMPL has 23, SMPL-X 21"
        )
    turns[:, 1:_BODY] = _turns(given, count, joints)[:, : _BODY - 1]
    for name, (first, last) in _PARTS.items():
        if name in document:
            turns[:, first:last] = _turns(document[name], count, last - first)
    has_face = any(name in document for name in ("jaw_pose", "expression", "leye_pose"))
    model = "smpl" if joints == 23 else "smplx"
    if joints == 21 and "left_hand_pose" in document and not has_face:
        model = "smplh"
    transl = document.get("transl", document.get("trans"))
    expression = document.get("expression")
    return _Record(
        tool,
        model,
        turns,
        betas.reshape(count, -1),
        None if expression is None else _rows(expression, np.shape(expression)[-1]),
        None if transl is None else _rows(transl, 3),
        camera=_cameras(document, count),
        mean_hands=mean_hands,
        is_placed=transl is not None,
        sigma_m=_SIGMA_M.get(tool, BodiesInFile.sigma_m),
    )


def _turns(values: Any, count: int, joints: int) -> _Array:
    """Return rotation vectors (N, joints, 3) of vectors or matrices."""
    given = matrix(values, "rotations")
    if given.size == 3 * count * joints:
        return given.reshape(count, joints, 3)
    if given.size != 9 * count * joints:
        raise ValueError(
            f"rotations of {joints} joints of {count} people have {given.size} numbers: give "
            f"vectors or matrices, and no principal components of hands"
        )
    matrices = given.reshape(count, joints, 3, 3)
    check_rotations(matrices)
    return rotmat_to_rotvec(matrices)


def _is_mesh(document: Any) -> bool:
    if isinstance(document, np.ndarray):
        return document.ndim > 1 and bool(document.shape[-1] == 3)
    return isinstance(document, Mapping) and any(hasattr(m, "faces") for m in document.values())


def _meshes(document: Any, file: FileOfPhoto) -> _Record:
    """Read vertices of a known topology; the file's axes are told by where the bodies are."""
    if isinstance(document, np.ndarray):
        vertices = _rows(document, *document.shape[-2:])
    else:
        sizes = {name: len(mesh.vertices) for name, mesh in document.items()}
        known = [name for name, size in sizes.items() if size in _VERTICES]
        if not known:
            found = ", ".join(str(size) for size in sizes.values())
            raise ValueError(
                f"its meshes have {found} vertices; SMPL has 6890, SMPL-X 10475, MHR 18439"
            )
        vertices = np.stack([np.asarray(document[name].vertices, np.float64) for name in known])
    count = vertices.shape[1]
    if count not in _VERTICES:
        raise ValueError(f"it has {count} vertices; SMPL has 6890, SMPL-X 10475, MHR 18439")
    model = _VERTICES[count]
    middle = np.median(vertices, axis=1)
    is_placed = bool((np.abs(middle[:, 2]) > _AT_ORIGIN_M).all())
    is_glb = file.path.suffix.lower() in (".glb", ".gltf")
    if is_glb and model == "mhr":
        raise ValueError(
            "a GLB of MHR holds the pose at rest and a skin that moves it: save SAM 3D Body's PLY, "
            "or its arrays"
        )
    tool, focal = "CameraHMR", None
    if (middle[:, 2] < 0).all() and is_placed:
        tool = "4D-Humans" if model == "smpl" else "SAM 3D Body"
        vertices = vertices * [1, -1, -1]
        focal = _CROP_FOCAL * max(file.size) if model == "smpl" else _focal_beside(file.path)
    elif is_placed:
        tool = "Multi-HMR" if model == "smplx" else f"{model} mesh"
        vertices = vertices * ([-1, -1, 1] if is_glb else [1, 1, 1])
        focal = _MULTI_HMR_FOCAL * max(file.size) if model == "smplx" else None
    return _Record(
        tool,
        model,
        vertices=vertices,
        camera=None if focal is None else _centred(focal, file.size, len(vertices)),
        is_placed=is_placed,
        sigma_m=_SIGMA_M.get(tool, BodiesInFile.sigma_m),
        notes=() if is_placed else ("the given meshes state no place: keypoints place them",),
    )


def _focal_beside(path: Path) -> float | None:
    """Return the focal length of the JSON file that SAM 3D Body's notebook writes beside a PLY."""
    beside = path.with_name(f"{path.stem.partition('_mesh_')[0]}_focal_length.json")
    if not beside.is_file():
        return None
    value = open_document(beside)
    focal = value["focal_length"] if isinstance(value, Mapping) else value
    return float(matrix(focal, "focal_length").ravel()[0])


_FORMS: Sequence[tuple[Callable[[Any], bool], Callable[[Any, FileOfPhoto], _Record]]] = (
    (_has("smpl_params_incam"), _gvhmr),
    (_has("rotmat", "betas", "transl", "cam_int"), _prompt_hmr),
    (lambda document: bool(_people_of(document)), _sam_3d_body),
    (_is_wham, _wham),
    (_has("poses", "trans"), _amass),
    (_has("global_orient", "body_pose", "betas"), _parameters),
    (_is_mesh, _meshes),
)
