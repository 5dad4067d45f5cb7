"""Results of methods: those of this tool, and arrays that a user wrote."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.data_files import (
    DamagedFrameError,
    checked_numbers,
    naming_file_in_errors,
    read_npz,
)
from physic_bench.types import TOPOLOGY_OF_COUNT, BenchPerson, Prediction
from physic_core.body import JOINT_NAMES

if TYPE_CHECKING:
    from physic_bench.types import Frame
    from physic_core.types import Person, Reconstruction


LAYOUTS = {
    "physic": "photos/XX/FRAME/ of physic batch, or FRAME/reconstruction.json, or PICTURE-physic/",
    "plain": "FRAME.npz, where FRAME is the frame's id; folders of the id may be folders, _ or __",
}
"""Which files each reads, for messages."""


def read_physic(folder: Path, frame: Frame) -> Prediction | None:
    """Read the frame's result of this tool, in px of the frame's picture; None if there is none.
    People without a body are not in it.

    Raises:
        PhysicError: it is damaged.
    """
    from physic_batch.photos import photo_folder
    from physic_core import load_reconstruction
    from physic_core.files import paths_inside
    from physic_core.io.result_folder import is_result

    for name in _possible_names(frame):
        folders = paths_inside(folder, (photo_folder(name), name, f"{name}-physic"))
        for result_folder in folders.values():
            if is_result(result_folder):
                result = load_reconstruction(result_folder)
                floor = result.scene.floor
                return Prediction(
                    tuple(
                        _bench_person(p, result)
                        for p in result.people
                        if np.isfinite(p.joints).all()
                    ),
                    result.intrinsics.resized(frame.camera.width, frame.camera.height).matrix,
                    None if floor is None else np.array([*floor.normal, floor.offset], np.float64),
                )
    return None


def _bench_person(person: Person, result: Reconstruction) -> BenchPerson:
    contact = person.contact
    if person.contact_partner is not None:  # no data set annotates contact with the own body
        touches_self = np.array(
            [*(partner.kind == "self" for partner in result.contact_partners), False]
        )
        contact = contact & ~touches_self[person.contact_partner]
    topology = "physic-embedded-1" if result.body_model == "embedded" else result.body_model
    return BenchPerson(
        joints=person.joints.astype(np.float64),
        joint_names=JOINT_NAMES,
        vertices=person.vertices.astype(np.float64),
        topology=topology,
        contact=contact,
        contact_topology=topology,
        marks=person.marks,
    )


def read_plain(folder: Path, frame: Frame) -> Prediction | None:
    """Read FRAME.npz; None if there is none.

    It has, of P people, ``vertices`` (P, V, 3) m of a known mesh, or ``joints`` (P, J, 3) with
    ``joint_names`` (J), or both. Optional: ``K`` (3, 3), ``contact`` (P, V), ``floor`` (4,). P may
    be 0.

    Raises:
        DamagedFrameError: it is damaged.
    """
    path = next(
        (p for name in _possible_names(frame) if (p := folder / f"{name}.npz").is_file()), None
    )
    if path is None:
        return None
    arrays = read_npz(path)
    with naming_file_in_errors(path):
        main = next((name for name in ("vertices", "joints") if name in arrays), None)
        if main is None:
            raise DamagedFrameError(
                f"there are no vertices and no joints: it has {', '.join(sorted(arrays))}"
            )
        per_person = [name for name in ("vertices", "joints", "contact") if name in arrays]
        if len({len(arrays[name]) for name in per_person}) > 1:
            raise DamagedFrameError(f"the first axes of {', '.join(per_person)} must be the people")
        people = tuple(_plain_person(arrays, row) for row in range(len(arrays[main])))
        K = checked_numbers(arrays["K"], (3, 3), "K") if "K" in arrays else None
        return Prediction(
            people,
            K,
            checked_numbers(arrays["floor"], (4,), "floor") if "floor" in arrays else None,
        )


def _plain_person(arrays: Mapping[str, Any], row: int) -> BenchPerson:
    person = BenchPerson()
    if "vertices" in arrays:
        vertices = checked_numbers(arrays["vertices"][row], (-1, 3), "vertices")
        if not 0.2 < np.ptp(vertices, axis=0).max() < 3.0:
            raise DamagedFrameError("vertices must be of a person in meters")
        person = replace(person, vertices=vertices, topology=_topology(arrays, len(vertices)))
    if "joints" in arrays:
        joints = np.asarray(arrays["joints"][row], np.float64)
        names = tuple(map(str, np.ravel(arrays["joint_names"])))
        if joints.shape != (len(names), 3) or not np.isfinite(joints).any():
            raise DamagedFrameError(
                f"joints must be (P, {len(names)}, 3), as joint_names has, and not all NaN"
            )
        person = replace(person, joints=joints, joint_names=names)
    if "contact" in arrays:
        contact = checked_numbers(arrays["contact"][row], (-1,), "contact") >= 0.5
        person = replace(person, contact=contact, contact_topology=_topology(arrays, len(contact)))
    return person


def _topology(arrays: Mapping[str, Any], count: int) -> str:
    return (
        str(arrays["topology"])
        if "topology" in arrays
        else TOPOLOGY_OF_COUNT.get(count, f"{count} vertices")
    )


def _possible_names(frame: Frame) -> Iterator[str]:
    """Yield the names that other tools give to a frame: its id, with and without folders, and its
    picture's.
    """
    yield from (frame.id, frame.id.replace("/", "_"), frame.id.replace("/", "__"))
    if frame.picture is not None:
        yield frame.picture.path.stem
    if "/" in frame.id:
        yield frame.id.rpartition("/")[2]


READERS: Mapping[str, Callable[[Path, Frame], Prediction | None]] = {
    "physic": read_physic,
    "plain": read_plain,
}
