"""Mocks of the body estimator and the hand estimator."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.body.joints import JOINT_INDEX
from physic_core.types import Bodies, BodyParameters, Hands
from physic_mock.body_noise import (
    BONES,
    LIMBS,
    camera_rotations,
    depth_flip,
    draw_bone_errors,
    hidden_bones,
    line_of_sight_axes,
    local_rotations,
)
from physic_mock.noise import add_rotation_noise, bernoulli, seeded_rng
from physic_mock.recognition import MockOptions, match_masks_to_world, recognise_world

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, Intrinsics, Keypoints, People, UInt8Array
    from physic_testing.worlds import World

_WRISTS = (20, 21)
_FLIPPABLE = {
    f"{side}_{joint}": f"{side}_{child}"
    for joint, child in (
        ("shoulder", "elbow"),
        ("elbow", "wrist"),
        ("hip", "knee"),
        ("knee", "ankle"),
    )
    for side in ("left", "right")
}
"""Joint at the start of a limb segment -> joint at its end."""


# All are standard deviations, unless stated otherwise.
_LEAN_DEG = 10.0  # of bones about each axis across the line of sight
_PLANE_DEG = 6.0  # of bones about the line of sight
_LIMB_SHARE = 0.5  # of the variance of both, in common for all bones of an arm, a leg or the trunk
_TRUNK_FACTOR = 0.5  # on both, of trunk, neck and head
_HIDDEN_FACTOR = 2.0  # on both, of bones whose end is hidden
_ROOT_DEG = 6.0  # of the trunk between limbs that stay
_ROOT_LEAN_FACTOR = 2.2  # on it, across the line of sight
_PERSON_SIGMA = 0.3  # of the logarithm of a person's factor on all of these rotations
_FLIPPED = 0.06  # share of segments that point towards the camera, not away
_FLIPPED_FOREARMS = 0.15  # the same of forearms
_SHAPE_SIGMA = 0.4  # of each shape component; those that change the stature less
_STATURE_SIGMA = 0.045  # of the logarithm of stature over the true one
_DEPTH_SHARE = 0.5  # of the variance of log distance, common to all people of a photo
_LATERAL_M = 0.03  # across the line of sight
_OBSERVED_ERRORS = 0.03  # share of joints whose reported visibility is wrong
_FINGER_DEG = 10.0  # of finger joints about each axis
_MISSED_HANDS = 0.1  # share of the hands in sight


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
        description="Standard deviation of the logarithm of distance, besides the error of "
        "stature, times the noise.",
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
        found = recognise_world(image)
        rows = match_masks_to_world(found, people)
        world = found.world
        rng = seeded_rng(found.world, options.noise_seed, "bodies")
        truth = world.parameters
        count = len(world.vertices)
        placed = _noisy_translations(world, options, rng, intrinsics)
        posed = np.stack(
            [
                _noisy_pose(
                    world, i, options, seeded_rng(world, options.noise_seed, f"pose of person {i}")
                )
                for i in range(count)
            ]
        )
        flips = bernoulli(_OBSERVED_ERRORS, options.noise, rng.random(world.joints_visible.shape))
        parameters = BodyParameters(
            global_orient=posed[:, 0],
            body_pose=posed[:, 1:].reshape(count, -1),
            left_hand_pose=np.zeros_like(truth.left_hand_pose),
            right_hand_pose=np.zeros_like(truth.right_hand_pose),
            jaw_pose=truth.jaw_pose.copy(),
            leye_pose=truth.leye_pose.copy(),
            reye_pose=truth.reye_pose.copy(),
            betas=_noisy_betas(world, options, rng),
            expression=truth.expression.copy(),
            transl=placed,
        )
        picked = replace(
            parameters, **{name: value[rows] for name, value in vars(parameters).items()}
        )
        return Bodies(
            parameters=picked,
            body_model=world.body_model,
            observed=(world.joints_visible ^ flips)[rows],
            rotation_sigma=None
            if options.stated_sigma is None
            else np.full((len(rows), BONES), options.stated_sigma),
        )


def _log_statures(world: World, options: BodyOptions) -> FloatArray:
    """Return the error (N,) of the logarithm of each person's stature, which decides the distance,
    too.
    """
    rng = seeded_rng(world, options.noise_seed, "statures", all_views=True)
    errors: FloatArray = options.noise * (
        options.stature_bias + _STATURE_SIGMA * rng.normal(size=len(world.vertices))
    )
    return errors


def _noisy_translations(
    world: World, options: BodyOptions, rng: np.random.Generator, camera: Intrinsics
) -> FloatArray:
    """Return translations (N, 3) float32 with log-normal errors along the line of sight, normal
    across it.
    """
    pelvis = world.joints[:, 0].astype(np.float64)
    common = rng.normal()
    own = rng.normal(size=len(pelvis))
    along = np.sqrt(_DEPTH_SHARE) * common + np.sqrt(1 - _DEPTH_SHARE) * own
    across = rng.normal(size=(len(pelvis), 2))
    moved = (
        pelvis
        * np.exp(options.noise * options.depth_noise * along + _log_statures(world, options))[
            :, None
        ]
    )
    if options.noise:
        moved *= [1.0, 1.0, camera.fx / world.intrinsics.fx]  # the same pixel of the other camera
    moved *= _seen_shapes(world, options)[1][:, None]
    for i, point in enumerate(pelvis):
        moved[i] += options.noise * _LATERAL_M * across[i] @ line_of_sight_axes(point)[:2]
    placed: FloatArray = (world.parameters.transl + moved - pelvis).astype(np.float32)
    return placed


def _noisy_pose(
    world: World, person: int, options: BodyOptions, rng: np.random.Generator
) -> FloatArray:
    """Return rotation vectors (22, 3) float32 of one person's root and body joints, with errors."""
    from scipy.spatial.transform import Rotation

    truth = world.parameters
    local = (
        np.concatenate([truth.global_orient[person], truth.body_pose[person]])
        .reshape(BONES, 3)
        .astype(np.float64)
    )
    sight = line_of_sight_axes(world.joints[person, 0].astype(np.float64))
    own = seeded_rng(world, options.noise_seed, f"how the pose of person {person} fares")
    fares = np.exp(_PERSON_SIGMA * own.normal())
    root_error = fares * np.radians(options.noise * _ROOT_DEG) * rng.normal(size=3)
    root_error = sight.T @ (sight @ root_error * [_ROOT_LEAN_FACTOR, _ROOT_LEAN_FACTOR, 1.0])
    errors = draw_bone_errors(
        sight,
        hidden_bones(world.joints_visible[person]),
        fares * options.noise * _LEAN_DEG,
        fares * options.noise * _PLANE_DEG,
        _LIMB_SHARE,
        _HIDDEN_FACTOR,
        _TRUNK_FACTOR,
        rng,
    )
    turn = Rotation.from_rotvec(root_error)
    seen = [
        (turn if limb == "trunk" else Rotation.identity()) * Rotation.from_rotvec(e) * g
        for e, g, limb in zip(errors, camera_rotations(local), LIMBS, strict=True)
    ]
    for joint, child in _FLIPPABLE.items():
        share = _FLIPPED_FOREARMS if "elbow" in joint else _FLIPPED
        if bernoulli(share, options.noise, own.random(1))[0]:
            j = JOINT_INDEX[joint]
            bone = (world.joints[person, JOINT_INDEX[child]] - world.joints[person, j]).astype(
                np.float64
            )
            seen[j] = depth_flip(bone, sight[2]) * seen[j]
    return local_rotations(seen).astype(np.float32)


def _noisy_betas(world: World, options: BodyOptions, rng: np.random.Generator) -> FloatArray:
    """Return betas (N, K) float32 with errors along stature, which are also those of distance, and
    across it.
    """
    betas, _ = _seen_shapes(world, options)
    growth = _log_stature_gradient(world.body_model)
    direction = growth / np.linalg.norm(growth)
    others = rng.normal(size=betas.shape)
    others -= (others @ direction)[:, None] * direction
    taller = _log_statures(world, options)[:, None] / np.linalg.norm(growth) * direction
    shapes: FloatArray = (betas + taller + options.noise * _SHAPE_SIGMA * others).astype(np.float32)
    return shapes


def _seen_shapes(world: World, options: BodyOptions) -> tuple[FloatArray, FloatArray]:
    """Return betas (N, K), a mean adult's for children who come out as adults, and (N,) how much
    taller these are.
    """
    betas = world.parameters.betas.astype(np.float64)
    taller = np.ones(len(world.ages))
    children = np.isfinite(world.ages) & (options.noise > 0)
    if children.any():
        import torch

        from physic_core.body import load_body

        own = torch.from_numpy(betas[children])
        model = load_body(world.body_model).to(dtype=torch.float64)
        with torch.no_grad():
            taller[children] = (model.stature(0 * own) / model.stature(own)).numpy()
        betas[children] = 0
    return betas, taller


@lru_cache(maxsize=2)
def _log_stature_gradient(body_model: str) -> FloatArray:
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
        options = self.options
        found = recognise_world(image)
        rows = match_masks_to_world(found, people)
        rng = seeded_rng(found.world, options.noise_seed, "hands")
        truth = found.world.parameters
        both = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1).reshape(-1, 2, 15, 3)
        rotvecs = add_rotation_noise(both, options.noise * _FINGER_DEG, rng)
        seen = found.world.joints_visible[:, list(_WRISTS)]
        seen = seen & ~bernoulli(_MISSED_HANDS, options.noise, rng.random(seen.shape))
        return Hands(rotvecs=rotvecs[rows], confidence=np.where(seen, 0.9, 0.0)[rows])
