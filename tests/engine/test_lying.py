"""People who lie beneath the camera tell which way is down, and people who stand at a wall do not
mislead it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import load_config, reconstruct
from physic_core.body import load_body
from physic_core.body.bones import parameters_from_rotations
from physic_core.engine.ground.floor_and_scale import (
    find_ground,
    floor_evidence,
    scene_floor_candidates,
)
from physic_core.types import Bodies, Intrinsics, SurfaceLabels
from physic_core.types.observations import POSTURES
from physic_testing.worlds import load_world

from .seen import photo_of, rays_of

CAMERA = Intrinsics.from_focal(200.0, 180, 240)
DISTANCE = 2.4
"""Of the surface behind the person, metres."""
BED_EDGE = 14
"""Column left of which the surface ends, half a metre above another one."""
DOWN = np.array([0.0, 0.0, -1.0])
"""Normal of a floor below a camera that looks straight down."""


def answer(turned=False, floor_m=None, gap_m=0.0, label=None, posture=None, up=None):
    """Floor and scale of a person before a surface that faces the camera; upside down in the
    picture if turned, and on a level floor below the camera, if it has a height. The surface may
    have a label, and the picture a direction up.
    """
    model = load_body("embedded")
    rotations, betas, _ = model.zero_pose(1)
    rotations[:, 0] = torch.diag(torch.tensor([-1.0, 1.0, -1.0] if turned else [1.0, -1.0, -1.0]))
    still = model(rotations, betas, torch.zeros(1, 3)).vertices[0]
    _, low, back = still.amax(0)
    y = -(low + still[:, 1].amin()) / 2 if floor_m is None else floor_m - low
    transl = torch.tensor([[0.0, float(y), DISTANCE - gap_m - float(back)]])
    depth = np.full((CAMERA.height, CAMERA.width), DISTANCE)
    depth[:, :BED_EDGE] += 0.5
    if floor_m is not None:
        depth = np.minimum(depth, floor_m / np.maximum(rays_of(CAMERA)[..., 1], 1e-6))
    photo = photo_of(model, model(rotations, betas, transl), depth, CAMERA)
    if label is not None:
        labels = SurfaceLabels(np.zeros(depth.shape, np.uint8), (label,))
        photo = replace(photo, people=replace(photo.people, surfaces=labels))
    if up is not None:
        scene = replace(photo.scene_map, up=np.array(up), up_sigma=2.0, up_source="edges")
        photo = replace(photo, scene_map=scene)
    bodies = Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded")
    if posture is not None:
        said = replace(photo.observations, posture_share=np.full(9, 1 / 9))
        said.posture[:] = 0.01 / 0.92
        said.posture[:, POSTURES.index(posture)] = 0.92
        photo = replace(photo, observations=said)
    evidence = floor_evidence(photo)
    floors = scene_floor_candidates(photo.scene_points, evidence)
    return find_ground(photo, bodies, model, floors, evidence)


@pytest.mark.parametrize(
    "given", [{}, {"turned": True}, {"posture": "lie"}, {"label": "bed"}], ids=str
)
def test_a_camera_looks_down_on_people_who_lie_on_one_plane_from_head_to_heel(given):
    found = answer(**given)
    assert found.plane.normal @ DOWN == pytest.approx(1.0, abs=0.01)
    assert found.plane.offset * found.scale.scale == pytest.approx(DISTANCE, rel=0.1)
    assert found.stance.stand_probability.max() < 0.1


@pytest.mark.parametrize("gap_m", [0.02, 0.4], ids=["at the wall", "before the wall"])
def test_people_who_stand_at_a_wall_on_a_floor_do_not_lie_on_the_wall(gap_m):
    found = answer(floor_m=1.0, gap_m=gap_m)
    assert found.plane is not None
    assert found.plane.normal @ DOWN == pytest.approx(0.0, abs=0.1)
    assert found.stance.stand_probability.min() > 0.5


STEEP = [(0.0, -np.sin(angle), -np.cos(angle)) for angle in np.radians([60.0, 30.0])]


@pytest.mark.parametrize(
    "given",
    [
        {"posture": "stand"},
        {"label": "wall"},
        {"gap_m": 0.8},
        {"up": STEEP[0]},
        {"posture": "lie", "up": STEEP[1]},
    ],
    ids=str,
)
def test_observer_label_distance_and_up_each_speak_against_people_who_lie(given):
    plane = answer(**given).plane
    assert plane is None or plane.normal @ DOWN < 0.9


def test_people_who_lie_touch_the_floor_with_back_head_and_seat(few_steps):
    result = reconstruct(load_world("lie").image, load_config(preset="mock"))
    likely = {one.part for one in result.people[0].contacts if one.likely}
    assert {"back", "head", "seat"} <= likely
    assert "torso" not in likely
