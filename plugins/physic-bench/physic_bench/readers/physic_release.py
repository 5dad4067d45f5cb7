"""The results that the paper's first author published: physic-eval-release, npz files for PROX and RICH."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_bench.bodies import BodyFiles
from physic_bench.contract import PredictedPerson, Prediction
from physic_bench.damage import DamagedFrameError, as_numbers, number_array, require_finite
from physic_bench.readers.base import ResultReader, archive_arrays, contact_of, first_file, person_of_body
from physic_bench.scene_surface import INSIDE_REACH_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.contract import Frame

    Array = NDArray[np.float64]

JOINTS = {
    "global_orient": 1,
    "body_pose": 21,
    "left_hand_pose": 15,
    "right_hand_pose": 15,
    "jaw_pose": 1,
    "leye_pose": 1,
    "reye_pose": 1,
}
TRANSLATION = ("cam_trans", "transl", "cam_transl", "translation", "trans")
"""Names of the translation; the card of the release calls it the camera translation."""

CONTACT_M = 0.02

MIN_CROSS = 1e-6
"""Length of the cross product of the first two columns of a rotation, 1 if they are exact."""

LAYOUT = (
    "{name}.npz",
    "prox/{name}.npz",
    "rich/{name}.npz",
    "release_data/prox/{name}.npz",
    "release_data/rich/{name}.npz",
    "release_data_full/prox/{name}.npz",
    "release_data_full/rich/{name}.npz",
)


class PhysicRelease(ResultReader):
    """Reads the final bodies; contact is the released rule on the released scene points."""

    name: ClassVar[str] = "physic-release"
    layout: ClassVar[str] = "release_data/prox/RECORDING/FRAME.npz, release_data/rich/FRAME.npz"
    prefix: ClassVar[str] = "final"

    def locate(self, frame: Frame) -> Path | None:
        """Return the file of the frame."""
        return release_file(self.folder, frame)

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Pose the bodies by the user's SMPL-X file."""
        arrays = archive_arrays(path)
        people = people_of_release(arrays, self.prefix, path, self.bodies)
        K = number_array(arrays, "K", path, (3, 3)) if "K" in arrays else None
        points = number_array(arrays, "scene_points", path, (-1, 3)) if "scene_points" in arrays else None
        return Prediction(people, K=K, scene_points=points)


def release_file(folder: Path, frame: Frame) -> Path | None:
    """Return the file of a frame in the release."""
    return first_file(folder, frame, *LAYOUT)


def people_of_release(
    arrays: Mapping[str, Any], prefix: str, path: Path, bodies: BodyFiles
) -> tuple[PredictedPerson, ...]:
    """Return the people of the start ("init") or the end ("final").

    Contact of the end is the rule of the released code on the scene points; that of the start is DECO's.

    Raises:
        DamagedFrameError: an array is missing or of another size.
        InputError: there is no SMPL-X file.
    """
    people = []
    for row, parameters in enumerate(release_parameters(arrays, prefix, path)):
        person = person_of_body(bodies.smplx_body(parameters))
        people.append(
            PredictedPerson(
                vertices=person.vertices,
                topology=person.topology,
                joints=person.joints,
                joint_names=person.joint_names,
                contact=_contact(arrays, prefix, row, person, path),
            )
        )
    return tuple(people)


def release_parameters(arrays: Mapping[str, Any], prefix: str, path: Path) -> list[dict[str, Array]]:
    """Return parameters of each person: rotation matrices, betas, transl.

    Raises:
        DamagedFrameError: an array is missing or of another size.
    """
    own = {name.removeprefix(f"{prefix}_"): arrays[name] for name in arrays if name.startswith(f"{prefix}_")}
    transl = next((own[name] for name in TRANSLATION if name in own), None)
    lacking = [name for name in ("betas", "global_orient", "body_pose") if name not in own]
    if transl is None:
        lacking.append(f"{' or '.join(TRANSLATION[:2])}")
    if lacking:
        raise DamagedFrameError(
            f"{path} has no {', '.join(f'{prefix}_{name}' for name in lacking)}; it has: {', '.join(sorted(arrays))}"
        )
    name = next(name for name in TRANSLATION if name in own)
    translations = number_array(own, name, path, (-1, 3))
    count = len(translations)
    numbers = {name: number_array(own, name, path, (count, -1)) for name in ("betas", *JOINTS) if name in own}
    found = []
    for row in range(count):
        values = {
            name: rotations_from_6d(numbers[name][row], joints, f"{prefix}_{name}", path)
            for name, joints in JOINTS.items()
            if name in numbers
        }
        found.append({**values, "betas": numbers["betas"][row], "transl": translations[row]})
    return found


def rotations_from_6d(given: Any, joints: int, name: str, path: Path) -> Array:
    """Return rotations (joints, 3, 3) of the released 6 numbers each: the first two columns of the matrix.

    Rotation vectors and matrices are taken too.

    Raises:
        DamagedFrameError: it has another size, or is not a rotation.
    """
    values = require_finite(as_numbers(given, f"{path}: '{name}'").reshape(-1), f"{path}: '{name}'")
    if values.size != 6 * joints:
        from physic_bench.bodies import rotations_of

        try:
            return rotations_of(values, joints, name)
        except DamagedFrameError as error:
            raise DamagedFrameError(f"{path}: {error}; 6 numbers a rotation were expected, {6 * joints}") from error
    first, second = values.reshape(joints, 2, 3).swapaxes(0, 1)
    if (np.linalg.norm(np.cross(first, second), axis=-1) < MIN_CROSS).any():
        raise DamagedFrameError(f"{path}: '{name}' has columns of a rotation that are zero or parallel")
    x = first / np.linalg.norm(first, axis=-1, keepdims=True)
    y = second - (x * second).sum(-1, keepdims=True) * x
    y /= np.linalg.norm(y, axis=-1, keepdims=True)
    found: Array = np.stack([x, y, np.cross(x, y)], -1)
    return found


def released_contact(vertices: Array, points: Array, normals: Array | None) -> NDArray[np.bool_]:
    """Return the contact (V,) of the released rule: within 2 cm of a scene point, or behind it by up to 15 cm.

    Args:
        vertices: (V, 3) m.
        points: (M, 3) m.
        normals: (M, 3) unit, out of the scene; None: only the distance counts.
    """
    from scipy.spatial import KDTree

    distance, row = KDTree(points).query(vertices, distance_upper_bound=INSIDE_REACH_M)
    near = np.isfinite(distance)
    touching: NDArray[np.bool_] = distance <= CONTACT_M
    if normals is not None:
        behind = np.zeros(len(vertices), bool)
        way = vertices[near] - points[row[near]]
        behind[near] = (way * normals[row[near]]).sum(-1) < 0
        touching |= behind
    return touching


def _contact(
    arrays: Mapping[str, Any], prefix: str, row: int, person: PredictedPerson, path: Path
) -> NDArray[np.bool_] | None:
    if prefix == "final" and "scene_points" in arrays:
        points = require_finite(number_array(arrays, "scene_points", path, (-1, 3)), f"{path}: 'scene_points'")
        own = number_array(arrays, "scene_normals", path, points.shape) if "scene_normals" in arrays else None
        return released_contact(np.asarray(person.vertices), points, own)
    if "contact_deco" not in arrays:
        return None
    contact = number_array(arrays, "contact_deco", path, (-1, 10475))
    return contact_of(contact[min(row, len(contact) - 1)])


READER = PhysicRelease
