"""The floor, who stands on it and the scale are one answer, which evidence moves and does not
switch.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.bones import parameters_from_rotations
from physic_core.engine.ground.floor import (
    FloorCandidate,
)
from physic_core.engine.ground.floor_and_scale import (
    find_ground,
    floor_evidence,
    scene_floor_candidates,
)
from physic_core.engine.ground.ground_near_people import feet_pixels
from physic_core.engine.ground.stance import Stance
from physic_core.engine.sizes.scale_vote import scaled_depth
from physic_core.geometry.floor import PlaneFit
from physic_core.types import (
    Bodies,
    CameraTrust,
    DepthMap,
    Intrinsics,
    Observations,
    People,
    SurfaceLabels,
)
from physic_core.types.arrays import select_people
from physic_core.types.known_sizes import KnownPeople

from .seen import photo_of, pointmap_of, rays_of

HEIGHT = 180
WIDTH = 160
CAMERA = Intrinsics.from_focal(150.0, WIDTH, HEIGHT)
UNIT = 3.7
"""Metres in one unit of the relative scene."""
CAMERA_HEIGHT = 1.45
ANKLES = [JOINT_INDEX[f"{s}_{j}"] for s in ("left", "right") for j in ("ankle", "foot")]


EMPTY = np.zeros((HEIGHT, WIDTH), bool)
ROW = rays_of(CAMERA)[..., 1]
"""Tangent of the angle by which each pixel looks down."""


def in_units(depth_m, **known):
    return pointmap_of(depth_m / UNIT, CAMERA, people_farther=(0.0, 0.1), **known)


def level(height_m):
    """Depth (H, W) of a level floor so far below the camera, and of a wall at 8 m."""
    with np.errstate(divide="ignore"):
        return np.minimum(np.where(ROW > 0, height_m / ROW, np.inf), 8.0)


def level_floor(height_m):
    up = torch.tensor([0.0, -1.0, 0.0])
    fit = PlaneFit(up, height_m / UNIT, torch.tensor(EMPTY), 0.5, 0.0, "lower image")
    return FloorCandidate(fit, {"pixels": 5.0})


NO_FLOOR = FloorCandidate(None, {"no pixel to explain": 1.5})
FLOOR = (level_floor(CAMERA_HEIGHT), NO_FLOOR)


STANDS = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
LIES = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))


class World:
    """People on a level floor before a wall at 8 m, or before another depth, seen by a level
    camera; the last one may be lifted.
    """

    def __init__(self, places, lifted=0.0, turn=STANDS, depth=None):
        model = load_body("embedded")
        rotations, betas, transl = model.zero_pose(len(places))
        rotations[:, 0] = torch.tensor(turn)
        lowest = model(rotations, betas, transl).vertices[..., 1].amax(1)
        transl[:, [0, 2]] = torch.tensor(places)
        transl[:, 1] = CAMERA_HEIGHT - lowest
        transl[-1, 1] -= lifted
        posed = model(rotations, betas, transl)
        self.depth = level(CAMERA_HEIGHT) if depth is None else depth
        self.photo = photo_of(model, posed, self.depth, CAMERA, UNIT, "coco23")
        self.bodies = Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded")

    def answer(self, candidates=FLOOR, depth=None, bodies=None, **changed):
        photo = replace(self.photo, **changed)
        evidence = floor_evidence(photo)
        model = load_body("embedded")
        return find_ground(photo, bodies or self.bodies, model, candidates, evidence, depth)

    def candidates(self, searched=True, **changed):
        photo = replace(self.photo, **changed)
        return scene_floor_candidates(photo.scene_points, floor_evidence(photo), searched=searched)

    def labelled(self, name, ground, **masks):
        labels = SurfaceLabels(ground.astype(np.uint8), ("unknown", name))
        return replace(self.photo.people, surfaces=labels, **masks)

    def without_feet(self, *people):
        observed = np.ones((len(self.photo.people), 55), bool)
        observed[np.ix_(people, ANKLES)] = False
        return replace(self.bodies, observed=observed)

    def moved(self, person, factor):
        """The feet of one person this many times as far away, at the same pixels."""
        places = self.bodies.parameters.transl.copy()
        feet = np.array([places[person, 0], CAMERA_HEIGHT, places[person, 2]])
        places[person] += (factor - 1) * feet
        parameters = replace(self.bodies.parameters, transl=places)
        return replace(self.bodies, parameters=parameters)

    def error(self, found):
        """Logarithm of the depth by an answer over the true one."""
        depth = scaled_depth(self.photo.scene_map, found.scale, CAMERA).depth
        return float(np.log(np.nanmedian(depth / self.depth)))


PLACES = [(-0.6, 3.0), (0.7, 3.8)]


@pytest.fixture(scope="module")
def world():
    return World(PLACES)


def test_soles_on_the_floor_give_the_scale(world):
    found = world.answer()
    assert world.error(found) == pytest.approx(0, abs=0.02)
    assert found.scale.sigma == pytest.approx(0.08, abs=0.02)
    assert found.search.reason == "found"
    assert (found.stance.stand_probability > 0.8).all()
    assert not found.guess_warning


def test_the_answer_names_who_spoke_for_floor_and_scale_and_who_contradicts():
    found = World(PLACES, lifted=1.0).answer()
    floor = found.witnesses["floor"]
    assert sum(row["probability"] for row in floor) == pytest.approx(1)
    assert [row["source"] for row in floor] == ["lower image", "no floor"]
    assert floor[0]["nats"]["pixels"] == 5.0
    soles = {row["person"]: row for row in found.witnesses["scale"] if row["by"] == "soles"}
    assert abs(soles[0]["log_ratio"]) < 0.1
    assert soles[0]["right"] > 0.9
    assert soles[1]["log_ratio"] < -0.3
    assert soles[1]["right"] < 0.3


def test_the_pitch_of_the_floor_is_less_certain_if_the_focal_length_is(world):
    guess = replace(CAMERA, focal_sigma=0.25)
    known = replace(guess, trust=CameraTrust.KNOWN)
    unsure, sure = (world.answer(camera=c).search.plane.pitch_sigma for c in (guess, known))
    assert math.degrees(sure) == pytest.approx(1.5)
    assert math.degrees(unsure) == pytest.approx(6, abs=0.5)


def test_torsos_give_the_scale_where_no_foot_is_seen_and_are_less_certain(world):
    found = world.answer(bodies=world.without_feet(0, 1))
    assert world.error(found) == pytest.approx(0, abs=0.04)
    assert 0.1 < found.scale.sigma < 0.25


def test_a_lifted_person_does_not_stand_and_hardly_moves_the_scale():
    world = World([(-0.6, 3.0), (0.7, 3.0)], lifted=0.6)
    found = world.answer()
    assert world.error(found) == pytest.approx(0, abs=0.08)
    assert found.stance.stand_probability[0].min() > 0.8
    assert found.stance.stand_probability[1].max() < 0.2


def test_the_plane_on_which_a_person_stands_is_the_floor(world):
    """A table of as many pixels would make these people giants."""
    table = level_floor(0.6)
    for order in ((table, *FLOOR), (FLOOR[0], table, NO_FLOOR)):
        found = world.answer(order)
        assert found.plane.offset == pytest.approx(CAMERA_HEIGHT / UNIT, rel=1e-4)
        assert world.error(found) == pytest.approx(0, abs=0.06)


def test_two_planes_that_tie_give_the_scale_between_them_and_a_larger_sigma(world):
    near = level_floor(CAMERA_HEIGHT / 1.15)
    far = level_floor(CAMERA_HEIGHT * 1.15)
    alone = [world.answer((one, NO_FLOOR)) for one in (near, far)]
    both = world.answer((near, far, NO_FLOOR))
    logs = sorted(math.log(one.scale.scale) for one in alone)
    assert logs[0] < math.log(both.scale.scale) < logs[1]
    assert both.scale.sigma > max(one.scale.sigma for one in alone)


@pytest.mark.parametrize("step", [0.0, 0.2, 0.4])
def test_no_evidence_near_a_limit_switches_the_scale(step):
    world = World([(-0.6, 2.5), (0.7, 2.8)])
    here, there = (
        math.log(world.answer(bodies=world.moved(1, 1.4 + step + more)).scale.scale)
        for more in (0, 0.02)
    )
    assert abs(there - here) < 0.02


def test_a_small_person_hardly_moves_the_scale_of_two_large_ones():
    world = World([(-0.6, 2.5), (0.7, 2.8), (0.3, 7.5)])
    found = world.answer(bodies=world.moved(2, 1.8))
    assert world.error(found) == pytest.approx(0, abs=0.5 * found.scale.sigma)


def test_people_who_contradict_each_other_make_the_scale_unsure():
    world = World([(-0.6, 2.5), (0.7, 3.0)])
    agree = world.answer()
    contradict = world.answer(bodies=world.moved(1, 1.8))
    assert contradict.scale.sigma > 1.5 * agree.scale.sigma
    notes = " ".join(contradict.scale.notes)
    assert "person 1" in notes or "not on the floor" in notes


def test_who_is_too_small_for_an_adult_on_the_floor_of_others_is_named():
    """A person of adult size whose feet are 1.6 times too far away is a child of 1.1 m, if nothing
    else is known.
    """
    world = World([(-0.6, 2.5), (0.7, 2.8), (0.1, 3.0)])
    bodies = world.moved(1, 1.6)
    assert world.answer(bodies=bodies).small_statures == {1: pytest.approx(1.1, abs=0.1)}
    assert world.answer().small_statures == {}
    known = KnownPeople(years=np.array([np.nan, 6.0, np.nan]))
    assert world.answer(bodies=bodies, known=known).small_statures == {}


@pytest.mark.parametrize(
    "known", [{"stature": np.array([1.7, np.nan])}, {"years": np.array([40.0, 40.0])}]
)
def test_people_of_known_stature_or_age_are_surer_witnesses(world, known):
    surer = world.answer(known=KnownPeople(**known)).scale.sigma
    assert surer < world.answer().scale.sigma


def test_people_and_a_metric_depth_of_like_errors_meet_between_them(world):
    depth = DepthMap(np.float32(1.2 * world.depth), notes=("a network",))
    found = world.answer(depth=depth)
    off = math.log(np.nanmedian(found.depth.depth / world.depth))
    assert 0.02 < off < math.log(1.2) - 0.02
    assert found.scale.sigma < world.answer().scale.sigma
    assert found.depth.notes[0] == "a network"
    assert f"{math.exp(off) / 1.2:.3g}" in found.depth.notes[-1]


def test_people_at_several_depths_show_the_shift_of_the_inverse_depth():
    world = World([(-0.6, 2.5), (0.7, 4.0), (0.3, 7.5)])
    shift = 0.2
    shifted = 1 / (1 / world.depth + shift / UNIT)  # 1 / Z' = UNIT / Z + shift
    plane = np.array([0.0, UNIT / CAMERA_HEIGHT, shift])
    length = float(np.linalg.norm(plane))
    normal = torch.from_numpy((-plane / length).astype(np.float32))
    floor = replace(FLOOR[0], plane=replace(FLOOR[0].plane, normal=normal, offset=1 / length))
    original = UNIT * world.photo.photo_map.points[..., 2].astype(np.float64)
    photo = in_units(1 / (1 / original + shift / UNIT))
    scene = in_units(shifted, shift_sigma=0.3)
    found = world.answer((floor, NO_FLOOR), scene_map=scene, aligned_map=photo)
    ratio = scaled_depth(scene, found.scale, CAMERA).depth / world.depth
    assert np.nanquantile(ratio, [0.02, 0.98]) == pytest.approx([1, 1], abs=0.1)
    certain = world.answer((floor, NO_FLOOR), scene_map=in_units(shifted), aligned_map=photo)
    assert certain.scale.shift == 0


def test_without_people_the_scale_is_a_guess_that_names_its_assumption(world):
    bodies = replace(world.bodies, parameters=world.bodies.parameters[0:0])
    no_people = {
        "people": People(EMPTY[None][:0], np.zeros((0, 4)), np.zeros(0)),
        "bodies": bodies,
        "keypoints": select_people(world.photo.keypoints, np.zeros(2, bool)),
        "observations": Observations.unknown(0),
    }
    found = world.answer(**no_people)
    assert found.scale.sigma is None
    assert "1.45 m above the floor" in found.guess_warning
    assert "3 m" in world.answer((NO_FLOOR,), **no_people).guess_warning


@pytest.mark.parametrize("name", ["water", "sky", "wall"])
def test_no_label_hides_the_ground_under_soles_that_agree(world, name):
    lower = ~EMPTY
    lower[:, 35:125] = False
    scene = in_units(np.where(lower, level(CAMERA_HEIGHT + 0.5), world.depth))
    answers = []
    for label in ("floor", name):
        people = world.labelled(label, (ROW > 0.1) & ~lower)
        given = {"scene_map": scene, "people": people}
        candidates = world.candidates(**given)
        planes = [c for c in candidates if c.plane is not None]
        likeliest = max(planes, key=lambda c: c.log_score).plane
        assert likeliest.offset == pytest.approx(CAMERA_HEIGHT / UNIT, rel=0.05)
        answers.append(world.answer(candidates, **given))
    as_floor, other = answers
    assert other.plane.offset == pytest.approx(as_floor.plane.offset, rel=0.01)
    assert other.stance.stand_probability == pytest.approx(
        as_floor.stance.stand_probability, abs=0.02
    )


def test_people_on_a_box_do_not_lift_the_floor_off_the_ground_that_is_seen(world):
    street = ~EMPTY
    for x, y in feet_pixels(world.photo.keypoints, HEIGHT, WIDTH).round().astype(int):
        street[y - 12 : y + 13, x - 12 : x + 13] = False
    scene = in_units(np.where(street, level(CAMERA_HEIGHT + 0.35), world.depth))
    people = world.labelled("ground", street & (ROW > 0.25))
    given = {"scene_map": scene, "people": people}
    found = world.answer(world.candidates(**given), **given)
    assert found.plane.offset * UNIT == pytest.approx(CAMERA_HEIGHT + 0.35, rel=0.03)
    assert found.scale.scale > 0.88 * UNIT
    assert found.stance.stand_probability.max() < 0.1


def test_a_floor_that_is_switched_off_has_no_plane(world):
    (only,) = world.candidates(searched=False)
    assert only.plane is None


def test_a_plane_that_cuts_people_whose_feet_are_hidden_is_moved_down_to_them():
    world = World([(-0.5, 3.5), (0.6, 4.0)])
    table = (level_floor(CAMERA_HEIGHT - 0.6), NO_FLOOR)
    moved = world.answer(table, bodies=world.without_feet(0, 1))
    assert moved.plane.offset * moved.scale.scale == pytest.approx(CAMERA_HEIGHT, rel=0.1)
    kept = world.answer(FLOOR, bodies=world.without_feet(0, 1))
    assert kept.search.plane.reanchored == 1.0


def lying(height_m):
    """A person who lies across the picture, so high over the floor, on a block if it is high."""
    depth = level(CAMERA_HEIGHT)
    top = (CAMERA_HEIGHT - height_m) / np.maximum(ROW, 1e-6)
    front = 2.6
    block = np.where((top > front) & (top < 3.6), top, np.inf)
    block = np.where((ROW * front > CAMERA_HEIGHT - height_m), front, block)
    depth = np.where(ROW * block < CAMERA_HEIGHT, np.minimum(depth, block), depth)
    world = World([(0.0, 3.0)], height_m, LIES, depth)
    people = world.labelled("floor", depth == level(CAMERA_HEIGHT))
    return world, world.answer(people=people)


@pytest.mark.parametrize(("height_m", "on_floor"), [(0.0, True), (0.5, False)])
def test_people_who_lie_rest_on_the_floor_only_if_it_is_seen_right_below_them(height_m, on_floor):
    world, found = lying(height_m)
    assert (found.stance.rest_probability > 0.5).tolist() == [on_floor]
    assert (
        found.stance.limb_touch_probability.tolist()
        == Stance.unknown(1).limb_touch_probability.tolist()
    )
    assert world.error(found) == pytest.approx(0, abs=0.05 if on_floor else 0.2)


TOO_LOW = (level_floor(1.15 * CAMERA_HEIGHT), NO_FLOOR)


def placed(bodies, distance_sigma, joint_sigma=0.03):
    """Bodies that the user gives, of whose distances the logarithms have an error."""
    count = len(bodies.parameters)
    return replace(
        bodies,
        joint_sigma=np.full((count, 55), joint_sigma, np.float32),
        distance_sigma=np.full(count, distance_sigma, np.float32),
    )


def floor_height(found):
    return found.plane.offset * found.scale.scale


def test_a_floor_moves_to_the_soles_of_placed_bodies_by_the_stated_errors(world):
    without_place, unsure, sure = (
        floor_height(world.answer(TOO_LOW, bodies=placed(world.bodies, sigma)))
        for sigma in (np.inf, 0.06, 0.005)
    )
    estimated = floor_height(world.answer(TOO_LOW))
    assert without_place == pytest.approx(estimated, abs=0.002)
    assert without_place - 0.005 > unsure > sure + 0.005
    assert sure == pytest.approx(CAMERA_HEIGHT, rel=0.003)


def test_the_user_places_feet_that_no_pixel_shows(world):
    bodies = placed(world.without_feet(0, 1), 0.005)
    found = world.answer(TOO_LOW, bodies=bodies)
    assert floor_height(found) == pytest.approx(CAMERA_HEIGHT, rel=0.003)


def test_a_floor_does_not_follow_a_placed_body_in_the_air():
    world = World(PLACES, lifted=0.8)
    found = world.answer(TOO_LOW, bodies=placed(world.bodies, 0.005))
    assert floor_height(found) == pytest.approx(CAMERA_HEIGHT, rel=0.01)
