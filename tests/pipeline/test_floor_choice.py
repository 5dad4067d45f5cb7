"""The floor is the surface beside the feet if people stand on it, else what is labelled as floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.body.parameters import parameters_from_rotations
from physic_core.engine.scene.method import SceneMethod
from physic_core.geometry.rays import RayCaster
from physic_core.pipeline.floor_choice import FloorCandidate, choose_floor, floor_candidates
from physic_core.types import Bodies, Hints, Intrinsics, Keypoints, People, Plane, Pointmap, SurfaceLabels

HEIGHT, WIDTH, CAMERA_HEIGHT = 200, 160, 1.4
CAMERA = Intrinsics.from_focal(150.0, WIDTH, HEIGHT)
NO_KEYPOINTS = Keypoints(np.zeros((1, 17, 2), np.float32), np.zeros((1, 17), np.float32), "coco17")
FLOOR = FloorCandidate(None, Plane(np.array([0.0, -1.0, 0.0]), CAMERA_HEIGHT))
WALL = FloorCandidate(None, Plane(np.array([0.0, -0.6, -0.8]), 6.4))


def rays() -> np.ndarray:
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones_like(rows)], -1)


def empty_scene() -> Pointmap:
    """A floor before a wall at 8 m, in metres."""
    with np.errstate(divide="ignore"):
        floor = np.where(rays()[..., 1] > 0, CAMERA_HEIGHT / rays()[..., 1], np.inf)
    depth = np.minimum(floor, 8.0)
    points = (rays() * depth[..., None]).astype(np.float32)
    return Pointmap(points, np.ones((HEIGHT, WIDTH), bool), "scale", CAMERA, people_farther=(0.0, 0.1))


def hints_of(lifted: float) -> Hints:
    """Hints of one person at 3 m, whose soles are ``lifted`` metres over the floor."""
    model = load_body("embedded")
    rotations, betas, _ = model.zero_pose()
    rotations[:, 0] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
    lowest = float(model(rotations, betas, torch.zeros(1, 3)).vertices[..., 1].max())
    transl = torch.tensor([[0.0, CAMERA_HEIGHT - lowest - lifted, 3.0]])
    vertices = model(rotations, betas, transl).vertices[0].double().numpy()
    hits = RayCaster(vertices, model.faces.numpy()).first(np.zeros(3), rays().reshape(-1, 3).astype(float))
    mask = (hits.face >= 0).reshape(HEIGHT, WIDTH)
    scene = empty_scene()
    points = np.where(mask[..., None], rays() * hits.distance.reshape(HEIGHT, WIDTH, 1), scene.points)
    photo = replace(scene, points=points.astype(np.float32))
    people = People(mask[None], np.zeros((1, 4)), np.ones(1))
    bodies = Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded")
    return Hints(CAMERA, people, NO_KEYPOINTS, None, scene, photo, None, bodies)


@pytest.mark.parametrize(("lifted", "chosen"), [(0.0, FLOOR), (0.7, WALL)])
def test_the_first_floor_on_which_somebody_stands_is_chosen_and_else_the_last(lifted, chosen):
    floor, scores = choose_floor((FLOOR, WALL), hints_of(lifted), load_body("embedded"))
    assert floor is chosen
    assert scores.shape == (1,)


@pytest.mark.parametrize(("lifted", "expected"), [(0.0, 0.0), (0.35, np.log(0.75) / 0.1), (-0.35, np.log(1.25) / 0.1)])
def test_the_score_is_the_height_of_the_feet_over_the_chosen_floor_as_a_share_of_the_cameras(lifted, expected):
    _, scores = choose_floor((FLOOR,), hints_of(lifted), load_body("embedded"))
    assert scores == pytest.approx([expected], abs=0.15)


def without(hints: Hints, what: str) -> Hints:
    people, bodies, photo = hints.people, hints.bodies, hints.original
    lost = replace(bodies.parameters, transl=bodies.parameters.transl * np.nan)
    changes = {
        "bias": {"original": replace(photo, people_farther=None)},
        "people": {"people": None},
        "bodies": {"bodies": None},
        "feet": {"bodies": replace(bodies, observed=np.zeros((1, 55), bool))},
        "pixels": {"people": replace(people, masks=people.masks & False)},
        "places": {"bodies": replace(bodies, parameters=lost)},
        "depth": {"original": replace(photo, points=np.where(people.masks[0][..., None], np.inf, photo.points))},
    }
    return replace(hints, **changes[what])


@pytest.mark.parametrize("unknown", ["bias", "people", "bodies", "feet", "pixels", "places", "depth"])
def test_where_it_is_unknown_who_stands_the_floor_is_the_first(unknown):
    floor, scores = choose_floor((FLOOR, WALL), without(hints_of(0.7), unknown), load_body("embedded"))
    assert floor is FLOOR
    assert np.isnan(scores).all()


def labelled_people(beside_feet: np.ndarray, labels: bool) -> People:
    people = hints_of(0.0).people
    ground = np.zeros((HEIGHT, WIDTH), np.uint8)
    ground[130:] = 1
    surfaces = SurfaceLabels(ground, ("", "floor")) if labels else None
    return replace(people, floor=beside_feet & ~people.masks[0], surfaces=surfaces)


@pytest.mark.parametrize(
    ("rows", "labels", "count"), [(slice(40, 80), True, 2), (slice(130, 200), True, 1), (slice(40, 80), False, 1)]
)
def test_the_labelled_floor_is_a_candidate_where_it_is_elsewhere(rows, labels, count):
    beside = np.zeros((HEIGHT, WIDTH), bool)
    beside[rows] = True
    people = labelled_people(beside, labels)
    found = floor_candidates(empty_scene(), people, people.masks[0], NO_KEYPOINTS, SceneMethod())
    assert len(found) == count
    assert found[0].mask is people.floor
    plane = found[-1].plane
    if count == 2:
        assert plane.offset == pytest.approx(CAMERA_HEIGHT, rel=0.02)


def test_a_floor_that_is_switched_off_has_no_plane():
    people = labelled_people(np.ones((HEIGHT, WIDTH), bool), labels=True)
    (found,) = floor_candidates(empty_scene(), people, people.masks[0], NO_KEYPOINTS, SceneMethod(floor="off"))
    assert found.plane is None
