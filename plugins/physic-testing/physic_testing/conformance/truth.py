"""The truth of a world and the results of a backend, in one form, so that they can be compared."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.expect import CheckSkipped

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import Bodies, BoolArray, ContactProbability, FloatArray, Keypoints, Skeleton
    from physic_testing.worlds import World

__all__ = [
    "contact_on_embedded",
    "embedded_body",
    "mirrored_order",
    "model_of",
    "posed_bodies",
    "rotation_errors_deg",
    "true_hands",
    "true_keypoints",
    "true_wrists",
]


def true_keypoints(answer: Keypoints, world: World) -> tuple[FloatArray, FloatArray, BoolArray, Skeleton]:
    """The detected points that bodies have, and the true ones.

    Returns:
        Detected points (N, J, 2) px, true points (N, J, 2) px, which points are visible in the photo and detected
        (N, J) bool, and their skeleton.

    Raises:
        CheckSkipped: the skeleton is of a hand alone, or has no point of a body.
    """
    from physic_core.body.landmarks import fitted_keypoints
    from physic_testing.conformance.joint_sets import world_keypoints

    known = fitted_keypoints(answer)
    skeleton = known.joint_set
    if "hand21" in skeleton.name or not len(skeleton):
        raise CheckSkipped(f"worlds have no truth for the skeleton {skeleton.name!r}")
    truth, visible = world_keypoints(world, skeleton)
    return known.points, truth, visible & (known.confidence > 0), skeleton


def mirrored_order(names: tuple[str, ...]) -> list[int]:
    """Index (J,) of the joint on the other side for each joint; its own index where there is none."""
    place = {name: i for i, name in enumerate(names)}

    def twin(name: str) -> str:
        side, _, rest = name.partition("_")
        return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)

    return [place.get(twin(name), i) for i, name in enumerate(names)]


def true_hands(world: World) -> FloatArray:
    """(N, 2, 15, 3) rotation vectors of a world's hands, left then right."""
    truth = world.parameters
    both: FloatArray = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1).reshape(-1, 2, 15, 3)
    return both


def true_wrists(world: World) -> FloatArray:
    """(N, 2, 3) rotation vectors of a world's hands from the T-pose to the camera's frame, left then right."""
    from physic_core.body import JOINT_INDEX
    from physic_core.body.bones import world_from_local
    from physic_core.body.parameters import rotations_from_parameters
    from physic_core.body.rotations import log

    turns = world_from_local(rotations_from_parameters(world.parameters).double().numpy())
    wrists: FloatArray = log(turns[:, [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]])
    return wrists


def rotation_errors_deg(rotvecs: FloatArray, truth: FloatArray) -> FloatArray:
    """Angle (...) in degrees between two rotations, given as rotation vectors (..., 3) in radians."""
    from scipy.spatial.transform import Rotation

    first, second = (Rotation.from_rotvec(r.reshape(-1, 3).astype(np.float64)) for r in (rotvecs, truth))
    angles: FloatArray = np.degrees((first.inv() * second).magnitude()).reshape(rotvecs.shape[:-1])
    return angles


def posed_bodies(bodies: Bodies) -> tuple[FloatArray, FloatArray]:
    """Vertices (N, V, 3) and joints (N, 55, 3) in metres in the camera frame, on the embedded body.

    Bodies of another model are converted first, as the pipeline does.

    Raises:
        CheckSkipped: the model of these bodies is a file of the user.
    """
    import torch

    from physic_core.body.conversion import to_model
    from physic_core.body.parameters import rotations_from_parameters
    from physic_core.geometry.tensors import tensor

    model = model_of(bodies)
    p = to_model(bodies, model).parameters
    with torch.no_grad():
        out = model(rotations_from_parameters(p), tensor(p.betas), tensor(p.transl))
    return out.vertices.double().numpy(), out.joints.double().numpy()


@lru_cache(maxsize=1)
def embedded_body() -> BodyModel:
    """The body model named "embedded", loaded once."""
    from physic_core.body import load_body

    return load_body("embedded")


def model_of(bodies: Bodies) -> BodyModel:
    """The body model on which these bodies are checked.

    Raises:
        CheckSkipped: the model of these bodies is a file of the user, and they cannot be converted.
    """
    from physic_core.body.conversion import can_carry

    if not can_carry(bodies, embedded_body()):
        raise CheckSkipped(f"the body {bodies.body_model!r} has to be brought along")
    return embedded_body()


def contact_on_embedded(answer: ContactProbability) -> ContactProbability:
    """Contact probability (N, V) on the mesh of the embedded body, which is that of the worlds."""
    from physic_core.body import load_body
    from physic_core.body.conversion import contact_to_model

    return contact_to_model(answer, load_body("embedded"))
