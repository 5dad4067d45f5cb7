"""Mocks of what is known of each person: body, hands, contact."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.errors import BackendError
from physic_core.types import Bodies, BodyParameters, ContactProbability, Hands
from physic_mock.noise import generator, smooth_field, turned
from physic_mock.recognition import MockOptions, Recognised, match_people, recognise

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, Intrinsics, Keypoints, People, UInt8Array

__all__ = ["MockBodyEstimator", "MockContactPrior", "MockHandEstimator"]

_WRISTS = (20, 21)


class BodyOptions(MockOptions):
    """Settings of :class:`MockBodyEstimator`."""

    pose_noise_deg: float = Field(4.0, ge=0, le=60, description="Standard deviation about each axis of 21 joints.")
    orient_noise_deg: float = Field(4.0, ge=0, le=90, description="The same of the whole body.")
    shape_noise: float = Field(0.4, ge=0, le=3, description="Standard deviation of each shape component.")
    depth_noise: float = Field(
        0.35, ge=0, le=1, description="Standard deviation of log distance: people come out too near or too far."
    )
    lateral_noise_m: float = Field(0.05, ge=0, description="Standard deviation along x and along y, metres.")


class MockBodyEstimator(interfaces.BodyEstimator):
    """The world's bodies, turned at every joint and moved mostly along the line of sight; hands flat."""

    Options = BodyOptions

    def infer(
        self, image: UInt8Array, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
    ) -> Bodies:
        """Image (H, W, 3) of a world and people of it -> their bodies.

        Raises:
            BackendError: the image shows no world that the options name, or a person is nobody of it.
        """
        assert isinstance(self.options, BodyOptions)
        options = self.options
        found = recognise(image, options)
        rows = match_people(found, people)
        world, rng = found.world, generator(found.world, options.noise_seed, "bodies")
        truth, count = world.parameters, len(world.vertices)
        pelvis = world.joints[:, 0].astype(np.float64)
        moved = pelvis * np.exp(options.depth_noise * rng.normal(size=(count, 1)))
        moved[:, :2] += options.lateral_noise_m * rng.normal(size=(count, 2))
        parameters = BodyParameters(
            global_orient=turned(truth.global_orient, options.orient_noise_deg, rng),
            body_pose=turned(truth.body_pose.reshape(count, 21, 3), options.pose_noise_deg, rng).reshape(count, 63),
            left_hand_pose=np.zeros_like(truth.left_hand_pose),
            right_hand_pose=np.zeros_like(truth.right_hand_pose),
            jaw_pose=truth.jaw_pose.copy(),
            leye_pose=truth.leye_pose.copy(),
            reye_pose=truth.reye_pose.copy(),
            betas=(truth.betas + options.shape_noise * rng.normal(size=truth.betas.shape)).astype(np.float32),
            expression=truth.expression.copy(),
            transl=(truth.transl + moved - pelvis).astype(np.float32),
        )
        picked = replace(parameters, **{name: value[rows] for name, value in vars(parameters).items()})
        return Bodies(parameters=picked, body_model=world.body_model, observed=world.joints_visible[rows])


class HandOptions(MockOptions):
    """Settings of :class:`MockHandEstimator`."""

    noise_deg: float = Field(10.0, ge=0, le=90, description="Standard deviation about each axis of each finger joint.")


class MockHandEstimator(interfaces.HandEstimator):
    """The world's finger rotations with noise, of the hands whose wrist is seen."""

    Options = HandOptions

    def infer(self, image: UInt8Array, people: People, keypoints: Keypoints) -> Hands:
        """Image (H, W, 3) of a world and people of it -> their hands.

        Raises:
            BackendError: the image shows no world that the options name, or a person is nobody of it.
        """
        assert isinstance(self.options, HandOptions)
        found = recognise(image, self.options)
        rows = match_people(found, people)
        rng = generator(found.world, self.options.noise_seed, "hands")
        truth = found.world.parameters
        both = np.stack([truth.left_hand_pose, truth.right_hand_pose], axis=1).reshape(-1, 2, 15, 3)
        seen = found.world.joints_visible[:, list(_WRISTS)]
        return Hands(
            rotvecs=turned(both, self.options.noise_deg, rng)[rows],
            confidence=np.where(seen, 0.9, 0.0)[rows],
        )


class ContactOptions(MockOptions):
    """Settings of :class:`MockContactPrior`."""

    recall: float = Field(0.6, gt=0, le=1, description="Share of the true contact vertices that are found.")
    precision: float = Field(0.6, gt=0, le=1, description="Share of the found vertices that are true.")
    patch_m: float = Field(0.15, gt=0, description="Size of the patches that are missed or made up, metres.")


class MockContactPrior(interfaces.ContactPrior):
    """The world's contact with patches missed, and patches made up where the scene is near."""

    Options = ContactOptions

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Image (H, W, 3) of a world and people of it -> probability (N, V), above 0.5 where contact is found.

        Raises:
            BackendError: the image shows no world that the options name, a person is nobody of it, or the bodies are
                of another body model.
        """
        assert isinstance(self.options, ContactOptions)
        found = recognise(image, self.options)
        rows = match_people(found, people)
        if bodies.body_model != found.world.body_model:
            raise BackendError(
                f"The mock world's contact is for the body model {found.world.body_model!r}, got bodies of "
                f"{bodies.body_model!r}: use the mock body estimator, or another contact prior."
            )
        every = np.stack([_probability(found, i, self.options) for i in range(len(found.world.vertices))])
        return ContactProbability(probability=every[rows], topology=found.world.topology)


def _probability(found: Recognised, person: int, options: ContactOptions) -> FloatArray:
    """(V,) for one person: exactly the asked recall and precision, as far as whole vertices allow."""
    world = found.world
    rng = generator(world, options.noise_seed, f"contact of person {person}")
    field = smooth_field(world.vertices[person].astype(np.float64), options.patch_m, rng)
    true = np.flatnonzero(world.contact[person])
    others = np.flatnonzero(~world.contact[person] & world.outer)
    hits = true[np.argsort(-field[true])][: round(options.recall * len(true))]
    wrong = round(len(hits) * (1 - options.precision) / options.precision)
    # Made-up contact lies in patches, rather near the scene than far from it.
    temptation = field[others] - world.distance[person, others] / options.patch_m
    false = others[np.argsort(-temptation)][:wrong]
    probability = rng.uniform(0.0, 0.3, len(field))
    found_vertices = np.concatenate([hits, false])
    probability[found_vertices] = rng.uniform(0.6, 0.95, len(found_vertices))
    return probability
