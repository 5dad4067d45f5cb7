"""Results of this tool: the folder of ``physic batch``, of ``physic evaluate``, or one folder per frame."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physic_bench.contract import PredictedPerson, Prediction
from physic_bench.joints import LIMB_JOINTS
from physic_bench.readers.base import ResultReader, file_names
from physic_core.body.joints import JOINT_NAMES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.contract import Frame
    from physic_core.types import Person, Reconstruction

    Array = NDArray[np.float64]

MIN_CONFIDENCE = 0.3
"""Keypoints from which on triangulation uses them."""


class Physic(ResultReader):
    """Reads ``reconstruction.json`` and ``reconstruction.npz``."""

    name: ClassVar[str] = "physic"
    layout: ClassVar[str] = "photos/XX/FRAME/ of physic batch, or FRAME/reconstruction.json, or PICTURE-physic/"

    def locate(self, frame: Frame) -> Path | None:
        """Return the folder of the frame's result."""
        from physic_core.batch.photos import photo_folder

        for name in file_names(frame):
            for folder in (photo_folder(name), name, f"{name}-physic"):
                if (self.folder / folder / "reconstruction.json").is_file():
                    return self.folder / folder
        return None

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Read the people, contact, camera and floor."""
        from physic_core import load_reconstruction

        return prediction_of(load_reconstruction(str(path)), frame)


def prediction_of(result: Reconstruction, frame: Frame) -> Prediction:
    """Return what is measured of a result, in px of the frame's picture."""
    width, height = frame.camera.width, frame.camera.height
    factor = np.array([width / result.intrinsics.width, height / result.intrinsics.height])
    topology = {"embedded": "physic-embedded-1"}.get(result.body_model, result.body_model)
    people = [_person(person, topology, result, factor) for person in result.people]
    floor = result.scene.floor
    return Prediction(
        tuple(person for person in people if person.joints is not None),
        K=result.intrinsics.resized(width, height).matrix,
        scene_points=result.scene.points[result.scene.valid].astype(np.float64),
        floor=None if floor is None else np.array([*floor.normal, floor.offset], np.float64),
    )


def _person(person: Person, topology: str, result: Reconstruction, factor: Array) -> PredictedPerson:
    from physic_core.types import skeleton_named

    skeleton = result.skeleton if not isinstance(result.skeleton, str) else skeleton_named(result.skeleton)
    names = list(skeleton.names)
    keypoints = np.full((len(LIMB_JOINTS), 2), np.nan)
    for row, name in enumerate(LIMB_JOINTS):
        if name in names and person.keypoint_confidence[names.index(name)] >= MIN_CONFIDENCE:
            keypoints[row] = (person.keypoints[names.index(name)] + 0.5) * factor - 0.5
    finite = bool(np.isfinite(person.vertices).all() and np.isfinite(person.joints).all())
    return PredictedPerson(
        vertices=person.vertices.astype(np.float64) if finite else None,
        topology=topology,
        joints=person.joints.astype(np.float64) if finite else None,
        joint_names=tuple(JOINT_NAMES),
        contact=_contact(person, result),
        keypoints=keypoints,
        grade=str(person.grade or ""),
    )


def _contact(person: Person, result: Reconstruction) -> NDArray[np.bool_]:
    """Return contact with anything but the own body, which no data set annotates."""
    if person.contact_partner is None:
        return person.contact
    own = np.array([*(partner.kind == "self" for partner in result.contact_partners), False])
    found: NDArray[np.bool_] = person.contact & ~own[person.contact_partner]
    return found


READER = Physic
