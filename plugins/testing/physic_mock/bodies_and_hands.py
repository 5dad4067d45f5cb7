"""Mocks of the body estimator and the hand estimator.

Errors of poses are larger along the line of sight, correlated within a limb, and larger for hidden
bones. An image shows the direction of a bone in the image plane; the tilt out of the plane is
visible only as foreshortening, which hardly changes at small tilts. Errors about the two axes
across the line of sight are therefore larger than about the line of sight. Errors apply to bones in
the camera frame, so they do not add up along a limb, but each limb has a common part.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.body import JOINT_INDEX, JOINT_NAMES, PARENTS
from physic_core.types import Bodies, Hands
from physic_mock.noise import (
    DISTANCE_SHARE,
    FINGER_DEG,
    HIDDEN_FACTOR,
    LATERAL_M,
    LEAN_DEG,
    LIMB_SHARE,
    PLANE_DEG,
    POSE_SIGMA,
    ROOT_DEG,
    ROOT_LEAN_FACTOR,
    SHAPE_SIGMA,
    STATURE_SIGMA,
    TRUNK_FACTOR,
    Noise,
)
from physic_mock.recognition import MockOptions, match_masks_to_world, recognise_world

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from physic_core.types import (
        BoolArray,
        FloatArray,
        Hints,
        Intrinsics,
        Keypoints,
        People,
        UInt8Array,
    )

_WRISTS = (20, 21)
_SEGMENTS = [
    (f"{side}_{joint}", f"{side}_{child}")
    for joint, child in (
        ("shoulder", "elbow"),
        ("elbow", "wrist"),
        ("hip", "knee"),
        ("knee", "ankle"),
    )
    for side in ("left", "right")
]
"""Joints at the start and at the end of limb segments that may flip."""


class BodyOptions(MockOptions):
    """Options of :class:`MockBodyEstimator`."""

    stature_bias: float = Field(
        -0.06,
        ge=-0.5,
        le=0.5,
        description="Mean of the logarithm of stature over the true one, times the noise.",
    )
    stated_sigma: float | None = Field(
        None,
        gt=0,
        le=3,
        description="Returned standard deviation of all rotations, radians, whatever the noise.",
    )
    depth_noise: interfaces.Share = Field(
        0.05,
        description="Standard deviation of the logarithm of distance, times the noise; "
        "added to the error of stature.",
    )


class MockBodyEstimator(interfaces.BodyEstimator):
    """Body estimator that returns a world's bodies with errors typical of estimators.

    Hands are flat; the hand estimator returns their pose. With noise, distance follows from the
    size in the photo: the errors of stature and of focal length are errors of distance, too, and
    children come out as adults who are farther away.
    """

    written_for = 1
    Options = BodyOptions
    options: BodyOptions

    def infer(
        self,
        image: UInt8Array,
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """Return the bodies of people in a world's photo.

        Raises:
            BackendError: the image shows no world, or a person is not in it.
        """
        options = self.options
        recognised = recognise_world(image)
        rows = match_masks_to_world(recognised, people)
        world = recognised.world
        noise = Noise(world, options)
        rng = noise.rng("bodies")
        truth = world.parameters
        placed = _noisy_translations(noise, options, rng, intrinsics)
        posed = np.stack([_noisy_pose(noise, i) for i in range(len(placed))])
        wrong = noise.draw_is_below("wrong visibility", rng.random(world.joints_visible.shape))
        parameters = replace(
            truth,
            global_orient=posed[:, 0],
            body_pose=posed[:, 1:].reshape(len(posed), -1),
            left_hand_pose=np.zeros_like(truth.left_hand_pose),
            right_hand_pose=np.zeros_like(truth.right_hand_pose),
            betas=_noisy_betas(noise, options, rng),
            transl=placed,
        )
        picked = {name: value[rows] for name, value in vars(parameters).items()}
        sigma = options.stated_sigma
        return Bodies(
            parameters=replace(parameters, **picked),
            body_model=world.body_model,
            observed=(world.joints_visible ^ wrong)[rows],
            rotation_sigma=None if sigma is None else np.full((len(rows), _BONES), sigma),
        )


def _log_statures(noise: Noise, options: BodyOptions) -> FloatArray:
    """Return the error (N,) of the logarithm of each person's stature, which decides the distance,
    too.
    """
    drawn = noise.rng("statures", all_views=True).normal(size=len(noise.world.vertices))
    return noise.factor * (options.stature_bias + STATURE_SIGMA * drawn)


def _noisy_translations(
    noise: Noise, options: BodyOptions, rng: np.random.Generator, camera: Intrinsics
) -> FloatArray:
    """Return translations (N, 3) float32 with log-normal errors along the line of sight, normal
    across it.
    """
    world = noise.world
    pelvis = world.joints[:, 0].astype(np.float64)
    common = rng.normal()
    of_person = rng.normal(size=len(pelvis))
    along = np.sqrt(DISTANCE_SHARE) * common + np.sqrt(1 - DISTANCE_SHARE) * of_person
    across = rng.normal(size=(len(pelvis), 2))
    farther = noise.factor * options.depth_noise * along + _log_statures(noise, options)
    noisy_pelvis = pelvis * np.exp(farther)[:, None]
    if noise.factor:
        noisy_pelvis *= [
            1.0,
            1.0,
            camera.fx / world.intrinsics.fx,
        ]  # the same pixel of the other camera
    noisy_pelvis *= _estimated_shapes(noise)[1][:, None]
    for i, point in enumerate(pelvis):
        noisy_pelvis[i] += noise.factor * LATERAL_M * across[i] @ _line_of_sight_axes(point)[:2]
    placed: FloatArray = (world.parameters.transl + noisy_pelvis - pelvis).astype(np.float32)
    return placed


def _noisy_pose(noise: Noise, person: int) -> FloatArray:
    """Return rotation vectors (22, 3) float32 of one person's root and body joints, with errors."""
    from scipy.spatial.transform import Rotation

    world = noise.world
    truth = world.parameters
    local = np.concatenate([truth.global_orient[person], truth.body_pose[person]])
    joints = world.joints[person]
    sight = _line_of_sight_axes(joints[0].astype(np.float64))
    rng_of_fare = noise.rng(f"how the pose of person {person} fares")
    fares = np.exp(POSE_SIGMA * rng_of_fare.normal())
    rng = noise.rng(f"pose of person {person}")
    root_error = fares * np.radians(noise.factor * ROOT_DEG) * rng.normal(size=3)
    root_error = sight.T @ (sight @ root_error * [ROOT_LEAN_FACTOR, ROOT_LEAN_FACTOR, 1.0])
    visible = world.joints_visible[person]
    errors = _draw_bone_errors(sight, visible, fares * noise.factor, rng)
    turn = Rotation.from_rotvec(root_error)
    bones = _camera_rotations(local.reshape(_BONES, 3).astype(np.float64))
    rotations = [
        (turn if limb == "trunk" else Rotation.identity()) * Rotation.from_rotvec(error) * bone
        for error, bone, limb in zip(errors, bones, _LIMBS, strict=True)
    ]
    for joint, child in _SEGMENTS:
        share = "flipped forearms" if "elbow" in joint else "flipped segments"
        if noise.draw_is_below(share, rng_of_fare.random(1))[0]:
            j = JOINT_INDEX[joint]
            bone = (joints[JOINT_INDEX[child]] - joints[j]).astype(np.float64)
            rotations[j] = _depth_flip(bone, sight[2]) * rotations[j]
    return _local_rotations(rotations).astype(np.float32)


_BONES = 22
"""Number of body joints; each rotates the bone that follows it."""

_ARM = ("shoulder", "elbow", "wrist")
_LEG = ("hip", "knee", "ankle", "foot")


def _limb_of_joint(joint: str) -> str:
    """Return the limb of a joint."""
    side, _, name = joint.partition("_")
    if name in _ARM:
        return f"{side} arm"
    return f"{side} leg" if name in _LEG else "trunk"


_LIMBS = tuple(_limb_of_joint(name) for name in JOINT_NAMES[:_BONES])
"""Limb of each bone."""


def _line_of_sight_axes(point: FloatArray) -> FloatArray:
    """Return orthonormal rows (3, 3): two axes across the line of sight to a point (3,), and the
    line of sight.
    """
    line = point / np.linalg.norm(point)
    across = np.cross([0.0, 1.0, 0.0], line)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(line, across), line])


_LIMB_NUMBER = np.array([sorted(set(_LIMBS)).index(limb) for limb in _LIMBS])

_FIRST_CHILD = np.array(
    [PARENTS.index(j, 0, _BONES) if j in PARENTS[:_BONES] else j for j in range(_BONES)]
)


def _draw_bone_errors(
    sight: FloatArray, joints_visible: BoolArray, size: float, rng: np.random.Generator
) -> FloatArray:
    """Draw the errors of one person's bones as rotation vectors (22, 3), camera frame, radians; 0
    for the root.

    Args:
        sight: result of :func:`_line_of_sight_axes`.
        joints_visible: (J,) bool; a bone is hidden if the joint at its end is.
        size: factor on all errors.
        rng: random generator.
    """
    common = rng.normal(size=(len(set(_LIMBS)), 3))
    of_bone = rng.normal(size=(_BONES, 3))
    draws = np.sqrt(LIMB_SHARE) * common[_LIMB_NUMBER] + np.sqrt(1 - LIMB_SHARE) * of_bone
    factor = np.where(joints_visible[_FIRST_CHILD], 1.0, HIDDEN_FACTOR)
    factor = factor * np.where(np.array(_LIMBS) == "trunk", TRUNK_FACTOR, 1.0)
    sigmas = np.radians([size * LEAN_DEG, size * LEAN_DEG, size * PLANE_DEG])
    errors: FloatArray = (draws * sigmas) @ sight * factor[:, None]
    errors[0] = 0.0
    return errors


def _depth_flip(bone: FloatArray, sight: FloatArray) -> Rotation:
    """Return the rotation that mirrors the direction of a bone (3,) in the plane across the line of
    sight (3,) unit.

    The bone keeps its place in the image, and points away from the camera if it pointed towards it.
    """
    from scipy.spatial.transform import Rotation

    direction = bone / np.linalg.norm(bone)
    along = float(direction @ sight)
    axis = np.cross(direction, sight)
    length = np.linalg.norm(axis)
    if length < 1e-6:  # along the line of sight, where it has no place in the image to keep
        return Rotation.identity()
    return Rotation.from_rotvec(-2 * np.arcsin(np.clip(along, -1, 1)) * axis / length)


def _camera_rotations(local_rotations: FloatArray) -> list[Rotation]:
    """Convert rotation vectors (22, 3) relative to the parents to bone rotations in the camera
    frame.
    """
    from scipy.spatial.transform import Rotation

    turns: list[Rotation] = []
    for j in range(_BONES):
        turn = Rotation.from_rotvec(local_rotations[j])
        turns.append(turn if j == 0 else turns[PARENTS[j]] * turn)
    return turns


def _local_rotations(rotations: list[Rotation]) -> FloatArray:
    """Convert bone rotations in the camera frame to rotation vectors (22, 3) relative to the
    parents.
    """
    local = [rotations[0].as_rotvec()]
    local += [(rotations[PARENTS[j]].inv() * rotations[j]).as_rotvec() for j in range(1, _BONES)]
    return np.stack(local)


def _noisy_betas(noise: Noise, options: BodyOptions, rng: np.random.Generator) -> FloatArray:
    """Return betas (N, K) float32 with errors along stature, which are also those of distance, and
    across it.
    """
    betas, _ = _estimated_shapes(noise)
    growth = log_stature_gradient(noise.world.body_model)
    direction = growth / np.linalg.norm(growth)
    others = rng.normal(size=betas.shape)
    others -= (others @ direction)[:, None] * direction
    taller = _log_statures(noise, options)[:, None] / np.linalg.norm(growth) * direction
    shapes: FloatArray = (betas + taller + noise.factor * SHAPE_SIGMA * others).astype(np.float32)
    return shapes


def _estimated_shapes(noise: Noise) -> tuple[FloatArray, FloatArray]:
    """Return betas (N, K), a mean adult's for children who come out as adults, and (N,) how much
    taller these are.
    """
    import torch

    from physic_core.body import load_body

    world = noise.world
    betas = world.parameters.betas.astype(np.float64)
    taller = np.ones(len(world.ages))
    children = np.isfinite(world.ages) & (noise.factor > 0)
    if children.any():
        of_children = torch.from_numpy(betas[children])
        model = load_body(world.body_model).to(dtype=torch.float64)
        with torch.no_grad():
            taller[children] = (model.stature(0 * of_children) / model.stature(of_children)).numpy()
        betas[children] = 0
    return betas, taller


@lru_cache(maxsize=2)
def log_stature_gradient(body_model: str) -> FloatArray:
    """Return the derivative (K,) of log stature with respect to betas, at the mean shape."""
    import torch

    from physic_core.body import load_body

    model = load_body(body_model).to(dtype=torch.float64)
    with torch.no_grad():
        one = torch.eye(model.num_betas, dtype=torch.float64)
        growth: FloatArray = (model.stature(one) / model.stature(-one)).log().div(2).numpy()
    return np.round(growth, 9)  # products of matrices differ in their last bit between CPUs


class MockHandEstimator(interfaces.HandEstimator):
    """Hand estimator that returns a world's finger rotations with noise, for hands with a visible
    wrist.
    """

    written_for = 1
    Options = MockOptions
    options: MockOptions

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Return the hands of people in a world's photo.

        Raises:
            BackendError: the image shows no world, or a person is not in it.
        """
        from scipy.spatial.transform import Rotation

        recognised = recognise_world(image)
        rows = match_masks_to_world(recognised, people)
        noise = Noise(recognised.world, self.options)
        rng = noise.rng("hands")
        truth = recognised.world.parameters
        both = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1).astype(np.float64)
        error = np.radians(noise.factor * FINGER_DEG) * rng.normal(size=(both.size // 3, 3))
        turned = Rotation.from_rotvec(both.reshape(-1, 3)) * Rotation.from_rotvec(error)
        rotvecs = turned.as_rotvec().reshape(-1, 2, 15, 3).astype(np.float32)
        is_visible = recognised.world.joints_visible[:, list(_WRISTS)]
        is_visible = is_visible & ~noise.draw_is_below("missed hands", rng.random(is_visible.shape))
        return Hands(rotvecs=rotvecs[rows], confidence=np.where(is_visible, 0.9, 0.0)[rows])
