"""What the user knows of sizes holds in the result: statures, the camera's height, lengths between
pixels.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import KnownLength, KnownSizes, load_config
from physic_core.body import load_body
from physic_core.errors import ConfigError
from physic_core.prepare.people import known_people
from physic_core.types import PeoplePrompt
from physic_testing.worlds import load_world
from tests.pipeline.mocks import run

SIZE = (160, 120)
MODEL = load_body("embedded")


@pytest.fixture(scope="module")
def stand():
    return load_world("stand", SIZE)


def with_sizes(world, *lengths, **known):
    sizes = KnownSizes(lengths=lengths, **known)
    return run(world.image, "engine.joint.optimiser.steps=20", known=sizes)


@pytest.fixture(scope="module")
def free(stand):
    """The result without any known size."""
    return with_sizes(stand)


def stature(result):
    betas = np.concatenate([p.parameters.betas for p in result.people])
    return [float(s) for s in MODEL.stature(torch.from_numpy(betas).float())]


def given_and_result(result):
    return {m["name"]: (m["given"], m["result"]) for m in result.diagnostics["known_sizes"]}


def given_statures(result):
    return [person.measures.given_stature_m for person in result.people]


def contradictions(result):
    return [w for w in result.warnings if "contradict" in w or "not used" in w]


def test_a_person_has_the_given_stature_and_the_scene_follows(stand, free):
    height = 1.95
    held = with_sizes(stand, stature=(height,))
    assert stature(held)[0] == pytest.approx(height, rel=0.01)
    floor = held.scene.floor
    free_floor = free.scene.floor
    # Nothing else in a photo knows a length: the whole scene is as much larger.
    larger = height / stature(free)[0]
    assert floor.offset / free_floor.offset == pytest.approx(larger, rel=0.06)
    assert held.people[0].joints[0, 2] / free.people[0].joints[0, 2] == pytest.approx(
        larger, rel=0.06
    )
    assert contradictions(held) == []


def test_the_camera_stands_at_the_given_height(stand):
    result = with_sizes(stand, camera_height=1.2)
    assert result.scene.floor.offset == pytest.approx(1.2, rel=0.01)
    assert given_and_result(result)["the camera height"] == (1.2, pytest.approx(1.2, rel=0.01))
    assert result.scene.scale_sigma == pytest.approx(0.01)
    assert result.people[0].stature_sigma == pytest.approx(math.hypot(0.01, 0.05))


def test_two_points_of_the_scene_are_as_far_apart_as_given(stand):
    length = KnownLength((10.0, 100.0), (150.0, 100.0), 2.0)
    result = with_sizes(stand, length)
    a, b = result.scene.points[100, [10, 150]]
    assert result.scene.valid[100, [10, 150]].all()
    assert np.linalg.norm(a - b) == pytest.approx(2.0, rel=0.01)


def test_two_points_of_a_person_are_as_far_apart_as_given(stand):
    ends = stand.joints[0, [15, 7]] @ stand.intrinsics.matrix.T  # head and ankle
    start, end = (tuple(map(float, p[:2] / p[2])) for p in ends)
    result = with_sizes(stand, KnownLength(start, end, 1.2))  # 1.5 m in truth
    rays = np.array([[*start, 1.0], [*end, 1.0]]) @ np.linalg.inv(result.intrinsics.matrix).T
    # The body's surface under the two pixels, by ray casting.
    rays_of = result.people[0].mesh().ray
    points, ray, _ = rays_of.intersects_location(np.zeros((2, 3)), rays)
    first = [min(points[ray == i], key=lambda p: float(p[2])) for i in (0, 1)]
    assert np.linalg.norm(first[0] - first[1]) == pytest.approx(1.2, rel=0.02)
    assert list(given_and_result(result).values()) == [(1.2, pytest.approx(1.2, rel=0.02))]


WIDE = KnownLength((10.0, 100.0), (150.0, 100.0), 8.0)


@pytest.mark.parametrize(
    ("known", "message"),
    [
        (
            KnownSizes(stature=(2.2,), camera_height=1.1),
            r"of person 0 contradicts the camera height 1\.1 m, from which the photo shows a "
            r"person of 1\.\d\d m: ",
        ),
        (
            KnownSizes(camera_height=4.0),
            r"the photo contradicts the camera height 4 m: in a scene of that size it shows "
            r"person 0 as [345]\.\d\d m "
            r"tall; with people of usual stature it shows the camera height 1\.\d+ m\. ",
        ),
        (
            KnownSizes(camera_height=1.1, lengths=(replace(WIDE, metres=4.0),)),
            r"in the result the camera height is \d\.\d\d m and was given as 1\.10 m, the length "
            r"from \(10, 100\) to "
            r"\(150, 100\) is \d\.\d\d m and was given as 4\.00 m; correct the wrong one, or "
            r"leave it out",
        ),
    ],
)
def test_a_contradiction_beyond_three_standard_errors_is_refused(stand, known, message):
    with pytest.raises(ConfigError, match=message):
        run(stand.image, "engine.joint.optimiser.steps=20", known=known)


def test_a_size_within_three_standard_errors_is_used_and_a_difference_is_a_warning(stand, free):
    a, b = (free.scene.points[100, x] for x in (10, 150))
    height = float(free.scene.floor.offset)
    length = float(np.linalg.norm(a - b))
    result = with_sizes(stand, replace(WIDE, metres=1.2 * length), camera_height=height)
    (message,) = contradictions(result)
    assert message.startswith(
        "the given sizes contradict one another or the photo: in the result the camera height is"
    )
    assert result.scene.floor is not None


def test_people_and_their_statures_go_from_left_to_right():
    found = with_sizes(load_world("group", SIZE), stature=(1.7, 0, 1.75, 0))
    centres = [person.box[0] + person.box[2] for person in found.people]
    assert centres == sorted(centres)
    assert given_statures(found) == [pytest.approx(1.7), None, pytest.approx(1.75), None]


def test_a_given_stature_that_lifts_a_person_off_the_floor_is_a_warning():
    found = with_sizes(load_world("hug", SIZE), stature=(1.9, 1.55))
    (check,) = [check for check in found.checks if check.name == "given_size" and check.person == 1]
    assert check.ok
    (warning,) = [text for text in found.warnings if "does not stand on the floor" in text]
    assert warning.startswith("person 1 ")
    assert "1.55 m" in warning


def test_chosen_people_and_their_statures_stay_in_the_order_of_the_choice():
    world = load_world("group", SIZE)
    boxes = [tuple(map(float, box)) for box in sorted(world.boxes.tolist())[::-1][:2]]
    given = {"known": KnownSizes(stature=(1.75, 1.7)), "people": PeoplePrompt(boxes=boxes)}
    found = run(world.image, "engine.joint.optimiser.steps=4", **given)
    assert found.people[0].box[0] > found.people[1].box[0]
    assert given_statures(found) == pytest.approx([1.75, 1.7])


def test_too_many_statures_are_an_error():
    with pytest.raises(
        ConfigError,
        match=r"^2 statures were given, but 1 person was found: give one stature for all",
    ):
        known_people(KnownSizes(stature=(1.5, 1.6)), 1)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("stature=0.2", "a stature should be 0.4 to 2.6 meters, or 0 where unknown (got 0.2)"),
        (
            "camera_height=-1",
            "photo.camera_height: the camera height should be 0.01 to 100 meters",
        ),
        ("known_length=[1, 2, 30, 40, 0]", "a known length should be 0.01 to 1000 meters (got 0)"),
        (
            "known_length=[1, 2, 1, 2, 3]",
            "a known length needs two different pixels (got (1, 2) and (1, 2))",
        ),
    ],
)
def test_an_impossible_size_is_refused(setting, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        load_config(preset="mock", overrides=[f"photo.{setting}"])


def test_one_number_is_no_list_of_statures():
    with pytest.raises(ValueError, match=r"stature is a tuple.*: \(1\.8,\)"):
        KnownSizes(stature=1.8)


def test_sizes_of_the_command_line_are_in_the_result(tmp_path, stand, physic):
    from PIL import Image

    photo = tmp_path / "photo.png"
    Image.fromarray(stand.image).save(photo)
    quick = ["--preset", "mock", "--no-cache", "--set", "engine.joint.optimiser.steps=2"]
    a, b = (stand.points(people=True)[100, x] for x in (10, 150))
    tall = float(MODEL.stature(torch.tensor(stand.parameters.betas))[0])
    sizes = ["--stature", f"{tall:.2f}", "--camera-height", f"{stand.floor.offset:.2f}"]
    sizes += ["--known-length", f"10,100,150,100,{np.linalg.norm(a - b):.2f}"]
    out = physic("run", str(photo), "-o", str(tmp_path / "out"), *quick, *sizes)
    assert out.exit_code == 0, out.output
    from physic_core import load_reconstruction

    result = load_reconstruction(str(tmp_path / "out"))
    assert result.config["photo"]["stature"] == [round(tall, 2)]
    length = "the length from (10, 100) to (150, 100)"
    assert set(given_and_result(result)) == {"the stature of person 0", "the camera height", length}
