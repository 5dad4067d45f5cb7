"""Numbers of self-consistency on bodies whose answer is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.body.parameters import parameters_from_rotations
from physic_core.body.posture import lean_deg
from physic_core.types import BodyParameters, Intrinsics, Person, Plane, Reconstruction, Scene
from tools.consistency import (
    consistency,
    lowest_height,
    summarise,
)

CAMERA = Intrinsics.from_focal(600.0, 640, 480)
FLOOR = Plane(np.array([0.0, -1.0, 0.0]), 1.5)  # the camera is level, 1.5 m up


@pytest.fixture(scope="module")
def model():
    return load_body("embedded")


@dataclass(frozen=True)
class Figure:
    vertices: np.ndarray
    joints: np.ndarray
    parameters: BodyParameters
    keypoints: np.ndarray


def standing(model, lean=0.0, knee=0.0, lift=0.0):
    """One body on the floor 4 m ahead that faces the camera, leaning towards it by ``lean`` degrees."""
    rotations, betas, transl = model.zero_pose()
    rotations[0, 0] = torch.from_numpy(np.diag([1.0, -1.0, -1.0]) @ turned(math.radians(lean)))
    rotations[0, 4:6] = torch.from_numpy(turned(knee))
    posed = model(rotations, betas, transl)
    ankles, lowest = posed.joints[0, 7:9].mean(0), posed.vertices[0, :, 1].max()
    transl[0] = torch.stack([-ankles[0], 1.5 - lift - lowest, 4.0 - ankles[2]])
    posed = model(rotations, betas, transl)
    spots = model.landmarks(posed, "coco17")[0].double().numpy() @ CAMERA.matrix.T
    return Figure(
        posed.vertices[0].numpy(),
        posed.joints[0].numpy(),
        parameters_from_rotations(rotations, betas, torch.zeros(1, 0), transl),
        spots[:, :2] / spots[:, 2:],
    )


def turned(angle):
    return np.array([[1, 0, 0], [0, math.cos(angle), -math.sin(angle)], [0, math.sin(angle), math.cos(angle)]])


def reconstruction_of(model, figures, shift_px=0.0):
    people = []
    for figure in figures:
        heights = figure.vertices @ FLOOR.normal + FLOOR.offset
        people.append(
            Person(
                box=np.array([0, 100, 50, 300], np.float32),
                score=0.9,
                mask=np.zeros((480, 640), bool),
                keypoints=figure.keypoints + np.array([shift_px, 0.0]),
                keypoint_confidence=np.ones(17),
                parameters=figure.parameters,
                vertices=figure.vertices,
                joints=figure.joints,
                contact=np.abs(heights) < 0.02,
                distance=np.where(np.abs(heights) < 0.15, heights, np.inf),
            )
        )
    nothing = np.zeros((480, 640, 3), np.float32)
    image = nothing.astype(np.uint8)
    scene = Scene(nothing, nothing, image, np.zeros((480, 640), bool), FLOOR, np.zeros((0, 3)))
    return Reconstruction(image, CAMERA, scene, tuple(people), model.faces.int().numpy(), "embedded", "coco17")


def test_a_body_on_the_floor_that_fits_its_keypoints_is_consistent(model):
    result = reconstruction_of(model, [standing(model)])
    (person,) = consistency(result, model)
    assert person.keypoint_error_px == pytest.approx(0, abs=1e-3)
    assert person.contact_distance < 0.02
    assert person.inside_share == 0
    assert person.sole_height == pytest.approx(0, abs=1e-5)
    assert person.lowest_height == pytest.approx(0, abs=1e-5)
    assert person.lean_deg < 6  # the mean body's neck is not quite over its ankles


def test_a_shift_of_the_keypoints_is_their_error(model):
    (person,) = consistency(reconstruction_of(model, [standing(model)], shift_px=7.5), model)
    assert person.keypoint_error_px == pytest.approx(7.5, abs=1e-3)
    assert person.keypoint_error_share == pytest.approx(7.5 / 200, abs=1e-5)


@pytest.mark.parametrize("lift", [-0.1, -0.04, 0.06])
def test_a_lifted_body_is_so_high(model, lift):
    (person,) = consistency(reconstruction_of(model, [standing(model, lift=lift)]), model)
    assert person.sole_height == pytest.approx(lift, abs=1e-5)
    assert (person.inside_share > 0) == (lift < -0.03)


@pytest.mark.parametrize("lean", [-20.0, 10.0])
def test_a_lean_towards_the_camera_is_measured_with_its_sign(model, lean):
    upright = lean_deg(standing(model).joints, FLOOR)[1]
    total, part = lean_deg(standing(model, lean=lean).joints, FLOOR)
    assert part - upright == pytest.approx(lean, abs=1e-3)
    assert total == pytest.approx(abs(part), abs=0.5)


def test_without_a_floor_heights_are_unknown():
    assert math.isnan(lowest_height(np.zeros((2, 3)), None))
    assert lowest_height(np.array([[0, 1.0, 3], [0, 1.4, 3]]), FLOOR) == pytest.approx(0.1)


def test_a_photo_is_summarised_over_its_people(model):
    result = reconstruction_of(model, [standing(model), standing(model, lift=-0.1)], shift_px=2.0)
    people = consistency(result, model)
    summary = summarise(result, people)
    assert summary.people == 2
    assert summary.keypoint_error_px == pytest.approx(2.0, abs=1e-3)
    assert summary.inside_share == pytest.approx(people[1].inside_share / 2)
    assert math.isnan(summarise(reconstruction_of(model, []), ()).keypoint_error_px)
