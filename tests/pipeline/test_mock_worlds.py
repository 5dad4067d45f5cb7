"""The whole pipeline on worlds whose truth is known, with the mock backends: what stage 3 recovers,
in numbers.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import PARTNER_KINDS, SURFACE_NAMES, TOUCH_PARTS, TOUCHED
from physic_core.types.skeletons import SIDES
from physic_mock.observer import MockPersonObserver
from physic_mock.recognition import match_masks_to_world, recognise_world
from physic_testing.metrics import pa_mpjpe_mm
from physic_testing.worlds import load_world
from physic_testing.worlds.world import pixel_rays
from tests.pipeline.mocks import changed, run

pytestmark = [pytest.mark.quick, pytest.mark.kernels]

WORLDS = ("stand", "sit_on_stool", "hug")
MOCK = [
    "keypoint_detector.options.noise=0.15",
    "body_estimator.options.noise=0.8",
    "body_estimator.options.depth_noise=0.44",
    "body_estimator.options.stature_bias=0",
    "metric_depth.options.scale=1.1",
    "metric_depth.options.stated_sigma=0.095",
]
STAGE_2 = [
    'engine.joint.frozen=["root", "pose", "hands", "betas", "translation"]',
    "engine.joint.optimiser.steps=1",
]
DEPTH_SCALE = 1.1  # the mock's metric depth is this much too large


@pytest.fixture(scope="module")
def cases():
    worlds = [load_world(name, (160, 120)) for name in WORLDS]
    return [SimpleNamespace(world=one, result=run(one.image, *MOCK)) for one in worlds]


def vertex_error_mm(vertices, truth):
    return 1000 * float(np.linalg.norm(vertices - truth, axis=-1).mean())


@pytest.mark.slow
def test_stage_3_brings_people_nearer_to_the_truth(cases):
    rows = []
    for case in cases:
        boxes = case.world.boxes
        order = np.argsort(boxes[:, 0] + boxes[:, 2], kind="stable")
        after_stage_2 = run(case.world.image, *MOCK, *STAGE_2)
        people = zip(after_stage_2.people, case.result.people, order, strict=True)
        for placed, person, row in people:
            place = [
                vertex_error_mm(p.vertices, case.world.vertices[row]) for p in (placed, person)
            ]
            joints = np.stack([p.joints[:22] for p in (placed, person)]).astype(float)
            pose = pa_mpjpe_mm(joints, np.stack([case.world.joints[row, :22]] * 2))
            rows.append([*place, *pose])
    placed, after, pose_before, pose_after = np.mean(rows, axis=0)
    assert after < 0.75 * placed
    assert after < 130
    assert pose_after < 0.7 * pose_before


def test_the_scale_of_the_scene_is_recovered(cases):
    errors = []
    for case in cases:
        scene = case.result.scene
        valid = scene.valid
        ratio = np.median(scene.points[valid][:, 2] / case.world.empty_depth[valid])
        errors.append(abs(np.log(ratio)))
    assert np.mean(errors) < 0.5 * np.log(DEPTH_SCALE)


def test_the_floor_is_found(cases):
    for case in cases:
        found = case.result.scene.floor
        true = case.world.floor
        tilt = np.degrees(np.arccos(np.clip(found.normal @ true.normal, -1, 1)))
        assert tilt < 2
        assert abs(found.offset / true.offset - 1) < 0.1


def test_contact_of_worlds_is_found(cases):
    scores = []
    for case in cases:
        world = case.world
        others = [world.touched_person, world.touched_own_part, world.touched_item]
        for person, truth in zip(
            case.result.people, world.contact | np.any([t >= 0 for t in others], 0), strict=True
        ):
            hits = (person.contact & truth).sum()
            precision = hits / max(person.contact.sum(), 1)
            recall = hits / truth.sum()
            scores.append(2 * precision * recall / max(precision + recall, 1e-9))
    assert np.mean(scores) > 0.6


PARTNERS = (
    ("stand", "left_foot", "floor", ""),
    ("sit_on_chair", "seat", "scene", ""),
    ("hold_ball", "right_hand", "object", ""),
    ("hands_on_hips", "left_hand", "self", "torso"),
    ("hug", "right_hand", "person", "back"),
    ("hug", "back", "person", "right_hand"),
    ("sit_behind_table_other", "seat", "hidden", ""),
    ("kneel", "left_lower_leg", "floor", ""),
)
"""World, and a contact in it."""


@cache
def contacts_in(name):
    """Part, kind and part of the partner of each likely contact in a world."""
    people = run(load_world(name, (160, 120)).image).people
    contacts = [one for person in people for one in person.contacts if one.likely]
    return {(one.part, one.partner.kind, one.partner.part) for one in contacts}


@pytest.mark.parametrize(("name", "part", "kind", "other"), PARTNERS)
def test_each_partner_is_listed_in_some_world(name, part, kind, other):
    assert (part, kind, other) in contacts_in(name)
    assert {case[2] for case in PARTNERS} == {*PARTNER_KINDS}


def test_a_pull_that_takes_a_body_off_its_keypoints_is_dropped_with_a_note():
    """Two hands, .2 m from each other, of which the observer says that they meet."""

    def hands_meet(seen, image, people, *_):
        rows = match_masks_to_world(recognise_world(image), people)
        touch = np.full_like(seen.touch, 0.01)
        touch[..., TOUCHED.index("nothing")] = 0.96
        for row, hand in ((0, "left_hand"), (1, "right_hand")):
            own = touch[list(rows).index(row), TOUCH_PARTS.index(hand)]
            own[:] = 0.01
            own[TOUCHED.index("person")] = 0.96
        return replace(seen, touch=touch)

    backends = changed(MockPersonObserver, hands_meet)
    found = run(load_world("sit_side_by_side", (160, 120)).image, backends=backends)
    assert [note for note in found.notes if "stay apart" in note]
    listed = {one.part: one.distance_m for p in found.people for one in p.contacts}
    assert listed["right_hand"] > 0.1
    assert listed["left_hand"] > 0.1


def test_bodies_of_mock_worlds_do_not_sink_into_the_scene(cases):
    for case in cases:
        for person in case.result.people:
            assert person.distance.min() > -0.05, case.world.name


def test_legs_behind_a_table_are_named_as_unseen_and_limbs_in_the_open_are_not():
    legs = {f"{side}_{part}" for side in SIDES for part in ("upper_leg", "lower_leg", "foot")}
    for name, hidden in (("sit_behind_table_other", legs), ("lie", set())):
        (person,) = run(load_world(name, (160, 120)).image, "engine.joint.optimiser.steps=2").people
        assert set(person.unseen) == hidden


def test_a_photo_of_no_world_is_refused():
    with pytest.raises(BackendError, match="only know the photos of their own worlds"):
        run(np.full((120, 160, 3), 90, np.uint8))


@pytest.mark.usefixtures("few_steps")
def test_feet_on_pedals_are_not_on_the_floor_and_a_seat_without_depth_carries(monkeypatch):
    """A machine whose seat is .9 m over the floor, and its pedals .2 m; the depth has neither."""
    world = load_world("sit_on_stool", (160, 120))
    floor = replace(world.floor, offset=world.floor.offset + 0.2)
    floor_depth = -floor.offset / (pixel_rays(world.intrinsics) @ floor.normal)
    shown = world.empty_floor_mask | (world.empty_surfaces == SURFACE_NAMES.index("seat"))
    empty = np.where(shown, floor_depth.clip(0.1, 9), world.empty_depth).astype(np.float32)
    people = world.masks.any(0)
    machine = replace(
        world,
        floor=floor,
        empty_depth=empty,
        depth=np.where(people, world.depth, empty),
        empty_floor_mask=shown,
        floor_mask=shown & ~people,
        touched_surface=world.contact * np.uint8(SURFACE_NAMES.index("object")),
    )
    monkeypatch.setattr("physic_mock.recognition.load_world", lambda *_: machine)
    result = run(world.image)
    (person,) = result.people
    partners = {one.part: one.partner for one in person.support.contacts}
    assert partners["seat"].title == "seat"
    assert {partners[f"{side}_foot"].title for side in SIDES} == {"something seen"}
    assert "floor" not in {one.partner.kind for one in person.contacts}
    assert result.summary()["usable_place"] == 1
