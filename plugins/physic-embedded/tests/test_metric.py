from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
import trimesh

from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.convert.bodies import replace_mesh_with_joints
from physic_core.body.parameters import parameters_from_rotations
from physic_core.errors import BackendError, NoPersonError
from physic_core.types import Bodies, BodyParameters, Hints, Intrinsics, Keypoints, People, Plane, Pointmap
from physic_embedded.metric_depth import EmbeddedMetricDepth

HEIGHT, WIDTH = 180, 160
CAMERA = Intrinsics.from_focal(150.0, WIDTH, HEIGHT)
UNIT = 3.7
"""Metres in one unit of the relative scene."""
CAMERA_HEIGHT = 1.45
IMAGE = np.zeros((HEIGHT, WIDTH, 3), np.uint8)


def ray_directions() -> np.ndarray:
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    x, y = (columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy
    return np.stack([x, y, np.ones_like(x)], -1)


def as_pointmap(depth_m: np.ndarray) -> Pointmap:
    points = (ray_directions() * (depth_m / UNIT)[..., None]).astype(np.float32)
    return Pointmap(points, np.isfinite(depth_m), "inverse_scale_shift", CAMERA)


class World:
    """People who stand on a level floor before a wall at 8 m, seen by a level camera."""

    def __init__(self, places: list[tuple[float, float]], lifted: float = 0.0) -> None:
        model = load_body("embedded")
        rotations, betas, _ = model.zero_pose(len(places))
        rotations[:, 0] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
        still = model(rotations, betas, torch.zeros(len(places), 3))
        transl = torch.tensor([[x, 0.0, z] for x, z in places])
        transl[:, 1] = CAMERA_HEIGHT - still.vertices[..., 1].amax(1)
        transl[-1, 1] -= lifted
        vertices = model(rotations, betas, transl).vertices.double().numpy()
        directions = ray_directions()
        with np.errstate(divide="ignore"):
            floor = np.where(directions[..., 1] > 0, CAMERA_HEIGHT / directions[..., 1], np.inf)
        depth = np.minimum(floor, 8.0)
        masks = []
        original = depth.copy()
        for body in vertices:
            mesh = trimesh.Trimesh(body, model.faces.numpy(), process=False)
            flat = directions.reshape(-1, 3)
            hit = mesh.ray.intersects_first(np.zeros_like(flat), flat)
            corners = mesh.triangles[hit]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            z = (normal * corners[:, 0]).sum(1) / (normal * flat).sum(1)
            mask = (hit >= 0).reshape(HEIGHT, WIDTH)
            masks.append(mask)
            original[mask] = z.reshape(HEIGHT, WIDTH)[mask]
        self.depth = depth
        self.people = People(np.array(masks), np.zeros((len(masks), 4)), np.ones(len(masks)))
        self.bodies = Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded")
        self.hints = Hints(
            intrinsics=CAMERA,
            people=self.people,
            scene=as_pointmap(depth),
            original=as_pointmap(original),
            floor=Plane(np.array([0.0, -1.0, 0.0]), CAMERA_HEIGHT / UNIT),
            bodies=self.bodies,
        )


@pytest.fixture(scope="module")
def world() -> World:
    return World([(-0.6, 3.0), (0.7, 3.8)])


def test_soles_on_the_floor_give_the_scale(world: World) -> None:
    answer = EmbeddedMetricDepth().infer(IMAGE, world.hints)
    ratio = answer.depth / world.depth
    assert np.median(ratio) == pytest.approx(1, abs=0.01)
    assert answer.intrinsics == CAMERA
    assert answer.scale_sigma == pytest.approx(0.08, abs=0.005)
    assert "soles of 2 people" in answer.notes[0]


def test_body_size_gives_the_scale_where_no_floor_was_found(world: World) -> None:
    answer = EmbeddedMetricDepth().infer(IMAGE, replace(world.hints, floor=None))
    ratio = answer.depth / world.depth
    assert np.median(ratio) == pytest.approx(1, abs=0.02)
    assert answer.scale_sigma == pytest.approx(0.2, abs=0.01)
    assert "body size of 2 people" in answer.notes[0]


def test_unseen_feet_do_not_measure(world: World) -> None:
    observed = np.ones((2, 55), bool)
    observed[:, [JOINT_INDEX[f"{s}_{j}"] for s in ("left", "right") for j in ("ankle", "foot")]] = False
    hidden = replace(world.bodies, observed=observed)
    answer = EmbeddedMetricDepth().infer(IMAGE, replace(world.hints, bodies=hidden))
    assert answer.notes[0].startswith("the scale is from the body size of 2 people")
    observed[0, [JOINT_INDEX["left_ankle"], JOINT_INDEX["left_foot"]]] = True
    answer = EmbeddedMetricDepth().infer(IMAGE, replace(world.hints, bodies=replace(world.bodies, observed=observed)))
    assert "soles of 1 person" in answer.notes[0]
    assert np.nanmedian(answer.depth / world.depth) == pytest.approx(1, abs=0.01)


def test_a_person_who_stands_elsewhere_is_left_out_of_the_scale() -> None:
    world = World([(-0.8, 3.0), (0.0, 3.5), (0.9, 3.6)], lifted=0.9)
    answer = EmbeddedMetricDepth().infer(IMAGE, world.hints)
    assert np.nanmedian(answer.depth / world.depth) == pytest.approx(1, abs=0.01)
    assert "1 person not used" in answer.notes[1]


def move_away(world: World, person: int, factor: float) -> Hints:
    """Hints that put the feet of one person this many times as far away, at the same pixels."""
    places = world.bodies.parameters.transl.copy()
    feet = np.array([places[person, 0], CAMERA_HEIGHT, places[person, 2]])
    places[person] += (factor - 1) * feet
    parameters = replace(world.bodies.parameters, transl=places)
    return replace(world.hints, bodies=replace(world.bodies, parameters=parameters))


def test_a_small_person_does_not_move_the_scale_of_two_large_ones() -> None:
    world = World([(-0.6, 2.5), (0.7, 2.8), (0.3, 7.5)])
    answer = EmbeddedMetricDepth().infer(IMAGE, move_away(world, 2, 1.8))
    assert np.nanmedian(answer.depth / world.depth) == pytest.approx(1, abs=0.01)
    assert answer.scale_sigma < 0.15
    assert "1 person" in answer.notes[1]


def test_a_split_vote_keeps_the_scale_of_the_best_visible_person_and_is_unsure() -> None:
    world = World([(-0.6, 2.5), (0.7, 3.0)])
    answer = EmbeddedMetricDepth().infer(IMAGE, move_away(world, 1, 1.8))
    assert np.nanmedian(answer.depth / world.depth) == pytest.approx(1, abs=0.05)
    assert answer.scale_sigma > 0.15
    assert "best visible" in answer.notes[1]


def test_unsure_keypoints_count_less() -> None:
    world = World([(-0.6, 2.5), (0.7, 2.8)])
    hints = move_away(world, 0, 1.8)
    for confidence, factor in (([1.0, 0.3], 1.8), ([0.3, 1.0], 1.0)):
        points, sure = np.zeros((2, 17, 2), np.float32), np.array(confidence, np.float32)[:, None].repeat(17, 1)
        answer = EmbeddedMetricDepth().infer(IMAGE, replace(hints, keypoints=Keypoints(points, sure, "coco17")))
        assert np.nanmedian(answer.depth / world.depth) == pytest.approx(factor, rel=0.05)


def test_soles_of_a_tiny_person_do_not_outvote_a_large_one_without_visible_feet() -> None:
    world = World([(-0.2, 1.6), (0.9, 7.5)])
    observed = np.ones((2, 55), bool)
    observed[0, [JOINT_INDEX[f"{s}_{j}"] for s in ("left", "right") for j in ("ankle", "foot")]] = False
    hints = move_away(world, 1, 1.8)
    answer = EmbeddedMetricDepth().infer(IMAGE, replace(hints, bodies=replace(hints.bodies, observed=observed)))
    assert np.nanmedian(answer.depth / world.depth) == pytest.approx(1, abs=0.03)
    assert answer.notes[0].startswith("the scale is from the body size of 1 person")


def test_people_at_several_depths_show_the_shift_of_the_inverse_depth() -> None:
    world = World([(-0.6, 2.5), (0.7, 4.0), (0.3, 7.5)])
    shift = 0.2
    shifted = 1 / (1 / world.depth + shift / UNIT)  # 1 / Z' = UNIT / Z + shift
    plane = np.array([0.0, UNIT / CAMERA_HEIGHT, shift])
    original = world.hints.original.points[..., 2] * UNIT
    hints = replace(
        world.hints,
        scene=replace(as_pointmap(shifted), shift_sigma=0.3),
        original=as_pointmap(1 / (1 / original + shift / UNIT)),
        floor=Plane(-plane / np.linalg.norm(plane), 1 / float(np.linalg.norm(plane))),
    )
    ratio = EmbeddedMetricDepth().infer(IMAGE, hints).depth / world.depth
    assert np.nanquantile(ratio, [0.02, 0.98]) == pytest.approx([1, 1], abs=0.05)
    known = replace(hints, scene=as_pointmap(shifted))
    assert np.nanquantile(EmbeddedMetricDepth().infer(IMAGE, known).depth / world.depth, 0.02) < 0.9


def test_metric_depth_without_people_or_evidence_of_scale_is_an_error(world: World) -> None:
    nobody = Bodies(world.bodies.parameters[0:0], "embedded")
    with pytest.raises(NoPersonError, match="at least one person"):
        EmbeddedMetricDepth().infer(IMAGE, replace(world.hints, bodies=nobody))
    with pytest.raises(BackendError, match="no soles on a floor and no torso"):
        EmbeddedMetricDepth().infer(IMAGE, replace(world.hints, floor=None, original=None))
    with pytest.raises(BackendError, match="'smplx' bodies without joints"):
        EmbeddedMetricDepth().infer(IMAGE, replace(world.hints, bodies=Bodies(world.bodies.parameters, "smplx")))


def test_bodies_of_another_model_measure_by_their_joints(world: World) -> None:
    given = replace_mesh_with_joints(world.bodies, load_body("embedded"))
    nothing = {f.name: np.zeros_like(getattr(given.parameters, f.name)) for f in fields(given.parameters)}
    bodies = replace(given, parameters=BodyParameters(**nothing), body_model="mhr")
    for floor, most in ((world.hints.floor, 0.01), (None, 0.02)):
        answer = EmbeddedMetricDepth().infer(IMAGE, replace(world.hints, bodies=bodies, floor=floor))
        ratio = float(np.median(answer.depth / world.depth))
        assert ratio == pytest.approx(1, abs=most)
