"""Run this engine from the start of the published results, on their scene points: engine against engine.

The release holds no picture, masks, keypoints or depth of people. So the terms of reprojection and of human depth have
no data and are off; contact, penetration and the regularisation towards the start remain, as if people were hidden by
nothing but their own bodies. The preset is "default".
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.damage import number_array, require_finite
from physic_bench.readers.base import archive_arrays
from physic_bench.readers.physic_release import release_parameters, released_contact
from physic_core.body.joints import ROTATION_FIELDS
from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.bodies import BodyFiles
    from physic_core.engine.joint.problem import JointProblem

    Array = NDArray[np.float64]


def release_problem(arrays: Mapping[str, Any], path: Path, bodies: BodyFiles) -> JointProblem:
    """Return the joint problem of a file of the release.

    Raises:
        DamagedFileError: an array is missing, not finite, or of another size.
        InputError: there is no SMPL-X file.
    """
    import torch

    from physic_core.engine.joint.problem import JointProblem
    from physic_core.types import SKELETONS

    K, points, normals = release_scene(arrays, path)
    model = bodies.model("smplx")
    if model is None:
        raise InputError("the release holds parameters of SMPL-X: give --smplx FILE or FOLDER")
    people = release_parameters(arrays, "init", path)
    count, skeleton = len(people), SKELETONS["coco17"]
    rest = {name: np.tile(np.eye(3), (joints, 1, 1)) for name, joints in ROTATION_FIELDS}
    rotations = np.stack([np.concatenate([p.get(name, rest[name]) for name, _ in ROTATION_FIELDS]) for p in people])
    contact = np.zeros((count, model.num_vertices))
    if "contact_deco" in arrays:
        given = number_array(arrays, "contact_deco", path, (-1, model.num_vertices))
        contact[:] = given if len(given) == count else given[:1]

    # Nothing is known to hide people: all of the picture is theirs, all limbs count as visible, and only their own
    # bodies hide their vertices.
    width, height = (max(round(2 * side), 1) for side in K[:2, 2])

    def tensor(values: Any) -> torch.Tensor:
        return torch.tensor(np.asarray(values, np.float64))

    betas = np.stack([np.concatenate([p["betas"], np.zeros(model.num_betas)])[: model.num_betas] for p in people])
    return JointProblem(
        model=model.to(dtype=torch.float64),
        rotations0=tensor(rotations),
        betas0=tensor(betas),
        expression0=torch.zeros(count, model.num_expression, dtype=torch.float64),
        transl0=tensor(np.stack([p["transl"] for p in people])),
        keypoints=torch.full((count, len(skeleton), 2), float("nan"), dtype=torch.float64),
        keypoint_confidence=torch.zeros(count, len(skeleton), dtype=torch.float64),
        skeleton=skeleton,
        K=tensor(K),
        masks=torch.ones(count, height, width, dtype=torch.bool),
        scene_points=tensor(points),
        scene_normals=tensor(normals),
        contact_probability=tensor(contact),
        observed=torch.ones(count, 55, dtype=torch.bool),
    )


def release_scene(arrays: Mapping[str, Any], path: Path) -> tuple[Array, Array, Array]:
    """Return K (3, 3) px, scene points (M, 3) m and normals (M, 3) of a file of the release.

    Raises:
        DamagedFileError: an array is missing, not finite, or of another size.
    """
    K = require_finite(number_array(arrays, "K", path, (3, 3)), f"{path}: 'K'")
    points = require_finite(number_array(arrays, "scene_points", path, (-1, 3)), f"{path}: 'scene_points'")
    normals = number_array(arrays, "scene_normals", path, (len(points), 3))
    return K, points, require_finite(normals, f"{path}: 'scene_normals'")


def optimise_release(file: Path, bodies: BodyFiles) -> dict[str, Any]:
    """Return the arrays of the plain reader: vertices, joints and contact of the optimised people, and K.

    Args:
        file: of the release.
        bodies: the user's body models.

    Raises:
        DamagedFileError: the file is damaged, or has no array that is needed.
        InputError: there is no SMPL-X file.
    """
    from physic_core.engine.joint.solve import optimize
    from physic_core.engine.presets import DEFAULT

    arrays = archive_arrays(file)
    problem = release_problem(arrays, file, bodies)
    result = optimize(problem, DEFAULT.joint.without("depth"))
    vertices = result.vertices.detach().cpu().numpy()
    K, points, normals = release_scene(arrays, file)
    points = result.scene_scale * points
    return {
        "vertices": vertices,
        "joints": result.joints.detach().cpu().numpy(),
        "contact": np.stack([released_contact(own, points, normals) for own in vertices]),
        "K": K,
        "scene_points": points,
        "failures": np.array(result.failures),
    }
