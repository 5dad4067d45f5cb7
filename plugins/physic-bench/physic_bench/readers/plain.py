"""Results that a user wrote for this evaluation: one .npz file per frame, with a few arrays of documented names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_bench.bodies import SMPL_NAMES
from physic_bench.contract import TOPOLOGY_OF_COUNT, PredictedPerson, Prediction
from physic_bench.damage import DamagedFrameError, as_numbers
from physic_bench.meshes import require_metres
from physic_bench.readers.base import (
    ResultReader,
    archive_arrays,
    contact_of,
    first_file,
    person_of_body,
    person_of_vertices,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.contract import Frame

    Array = NDArray[np.float64]

_PER_PERSON = (
    "vertices",
    "joints",
    "body_pose",
    "global_orient",
    "betas",
    "transl",
    "contact",
    "keypoints",
)
_PARAMETERS = ("global_orient", "body_pose", "betas", "transl")


class Plain(ResultReader):
    """Reads .npz files of people, camera and scene.

    ``vertices`` (P, V, 3) m of a known mesh, or ``joints`` (P, J, 3) with ``joint_names`` (J), or parameters of SMPL-X
    (``body_pose`` of 21 joints) or SMPL (of 23) with the names of those models, each (P, ...). Optional: ``K`` (3, 3),
    ``contact`` (P, V), ``scene_points`` (M, 3), ``floor`` (4,), ``keypoints`` (P, 12, 2). P may be 0.
    """

    name: ClassVar[str] = "plain"
    layout: ClassVar[str] = "FRAME.npz, where FRAME is the frame's id; folders of the id may be folders, _ or __"

    def locate(self, frame: Frame) -> Path | None:
        """Return the file of the frame."""
        return first_file(self.folder, frame, "{name}.npz")

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Read the arrays."""
        arrays = archive_arrays(path)
        count = _count(arrays, path)
        people = tuple(self._person(arrays, row, path) for row in range(count))
        return Prediction(
            people,
            K=_array(arrays, "K", (3, 3), path),
            scene_points=_array(arrays, "scene_points", (-1, 3), path),
            floor=_array(arrays, "floor", (4,), path),
        )

    def _person(self, arrays: Mapping[str, Any], row: int, path: Path) -> PredictedPerson:
        def own(name: str) -> Array:
            return as_numbers(arrays[name][row], f"{path}: '{name}'")

        contact = own("contact") if "contact" in arrays else None
        joints: Array | None = None
        names: tuple[str, ...] = ()
        if "joints" in arrays:
            joints = own("joints")
            names = tuple(map(str, arrays["joint_names"].ravel())) if "joint_names" in arrays else _names(joints, path)
        if "vertices" in arrays:
            vertices = own("vertices")
            require_metres(vertices, path)
            person = person_of_vertices(vertices, _topology(arrays, len(vertices)), self.bodies, contact)
        elif "body_pose" in arrays:
            parameters = {name: own(name) for name in arrays if _is_parameter(name)}
            smpl = parameters["body_pose"].size in (69, 207)
            person = person_of_body((self.bodies.smpl_body if smpl else self.bodies.smplx_body)(parameters), contact)
        else:
            person = PredictedPerson(contact=contact_of(contact))
        return PredictedPerson(
            vertices=person.vertices,
            topology=person.topology,
            joints=person.joints if joints is None else joints,
            joint_names=person.joint_names if joints is None else names,
            contact=person.contact,
            contact_topology=_topology(arrays, person.contact.size) if person.contact is not None else "",
            keypoints=_shaped(own("keypoints"), (12, 2), "keypoints", path) if "keypoints" in arrays else None,
        )


def _is_per_person(name: str) -> bool:
    return name in _PER_PERSON or _is_parameter(name)


def _is_parameter(name: str) -> bool:
    return name in _PARAMETERS or name.endswith("_pose") or name == "expression"


def _count(arrays: Mapping[str, Any], path: Path) -> int:
    for name in ("vertices", "joints", "body_pose"):
        if name in arrays:
            count = len(np.atleast_1d(arrays[name]))
            flat = next((n for n in arrays if _is_per_person(n) and np.ndim(arrays[n]) < 2), None)
            if flat is not None:
                raise DamagedFrameError(
                    f"{path}: the first axis of '{flat}' must be the people, got {np.shape(arrays[flat])}"
                )
            other = next((n for n in arrays if _is_per_person(n) and len(arrays[n]) != count), None)
            if other is not None:
                raise DamagedFrameError(f"{path}: '{name}' is of {count} people and '{other}' of {len(arrays[other])}")
            return count
    raise DamagedFrameError(
        f"{path} has none of vertices, joints and body_pose (it has {', '.join(sorted(arrays)) or 'nothing'}): "
        "docs/evaluation.md lists the arrays"
    )


def _topology(arrays: Mapping[str, Any], count: int) -> str:
    return str(arrays["topology"]) if "topology" in arrays else TOPOLOGY_OF_COUNT.get(count, f"{count} vertices")


def _names(joints: Array, path: Path) -> tuple[str, ...]:
    from physic_core.body.joints import JOINT_NAMES

    if len(joints) == 24:
        return SMPL_NAMES
    if len(joints) in (22, 55):
        return tuple(JOINT_NAMES[: len(joints)])
    raise DamagedFrameError(f"{path}: {len(joints)} joints need their names, as an array joint_names ({len(joints)},)")


def _array(arrays: Mapping[str, Any], name: str, shape: tuple[int, ...], path: Path) -> Any:
    if name not in arrays:
        return None
    return _shaped(as_numbers(arrays[name], f"{path}: '{name}'"), shape, name, path)


def _shaped(values: Array, shape: tuple[int, ...], name: str, path: Path) -> Array:
    if len(values.shape) != len(shape) or any(s not in (-1, n) for s, n in zip(shape, values.shape, strict=True)):
        raise DamagedFrameError(f"{path}: '{name}' must have the shape {shape}, got {values.shape}")
    return values


READER = Plain
