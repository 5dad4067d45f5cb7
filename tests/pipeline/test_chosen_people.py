"""People whom the user chose, with segmenters that take prompts and with those that do not."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core import load_config, reconstruct
from physic_core.errors import BackendOutputError, ConfigError, NoPersonError
from physic_core.prepare.people import select_chosen
from physic_core.types import Keypoints, People, PeoplePrompt
from physic_mock import backends
from tests.pipeline.mocks import changed, without_people

pytestmark = pytest.mark.usefixtures("few_steps")

HEIGHT = 60
WIDTH = 100


def rectangle(x0, y0, x1, y1):
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[y0:y1, x0:x1] = True
    return mask


@pytest.fixture
def people():
    """Return a person on the left with a hidden right half, and one on the right; keypoints are the
    person's number.
    """
    boxes = np.array([[10, 10, 30, 50], [60, 10, 80, 50]], np.float32)
    points = np.arange(2, dtype=np.float32)[:, None, None].repeat(17, 1).repeat(2, 2)
    keypoints = Keypoints(points, np.ones((2, 17), np.float32), "coco17")
    masks = np.stack([rectangle(10, 10, 20, 50), rectangle(60, 10, 80, 50)])
    return People(
        masks, boxes, np.array([0.9, 0.8], np.float32), rectangle(0, 50, WIDTH, HEIGHT), keypoints
    )


def test_points_and_boxes_select_in_the_order_of_the_prompts(people):
    chosen = select_chosen(people, PeoplePrompt(points=((70, 20),), boxes=((8, 8, 28, 52),)))
    assert chosen.scores.tolist() == pytest.approx([0.8, 0.9])
    assert chosen.keypoints.points[:, 0, 0].tolist() == [1, 0]
    assert np.array_equal(chosen.masks, people.masks[::-1])


def test_a_point_on_the_hidden_half_of_a_person_hits_their_box(people):
    chosen = select_chosen(people, PeoplePrompt(points=((28, 20),)))
    assert np.array_equal(chosen.masks, people.masks[:1])
    (other,) = chosen.unposed
    assert (other.box, other.kind) == ((60, 10, 80, 50), "not chosen")
    assert not other.is_missing


def test_a_given_mask_is_kept_as_it_is_and_takes_pixels_of_others(people):
    mine = rectangle(70, 10, 100, 60)
    chosen = select_chosen(people, PeoplePrompt(points=((65, 20),), masks=mine[None]))
    assert np.array_equal(chosen.masks, np.stack([rectangle(60, 10, 70, 50), mine]))
    assert chosen.boxes.tolist() == [[60, 10, 70, 50], [70, 10, 100, 60]]
    assert np.array_equal(chosen.floor, rectangle(0, 50, 70, 60))
    assert chosen.scores.tolist() == pytest.approx([0.8, 1])  # the user is sure
    assert chosen.keypoints is None  # nobody was found where the mask is
    found = select_chosen(people, PeoplePrompt(masks=rectangle(60, 10, 78, 50)[None]))
    assert found.keypoints.points[:, 0, 0].tolist() == [1]


@pytest.mark.parametrize(
    ("prompt", "said"),
    [
        (
            PeoplePrompt(points=((70, 20), (50, 30))),
            r"^no person was found at point 2 \(50, 30\), in px of the photo at 100 x",
        ),
        (PeoplePrompt(boxes=((40, 10, 55, 50),)), r"at box 1 \(40, 10, 55, 50\), "),
        (
            PeoplePrompt(points=((70, 20), (72, 40))),
            r"^point 1 \(70, 20\) and point 2 \(72, 40\) hit the same person",
        ),
    ],
)
def test_a_prompt_that_hits_nobody_or_somebody_again_is_named(people, prompt, said):
    with pytest.raises(NoPersonError, match=said):
        select_chosen(people, prompt)


class Prompted(backends.MockSegmenter):
    takes_prompt = True

    def infer(self, image, prompt=None):
        found = super().infer(image)
        return found if prompt is None else select_chosen(found, prompt)


@pytest.mark.parametrize("kind", [backends.MockSegmenter, Prompted])
def test_an_ignored_person_is_left_out_of_people_and_scene(world, kind):
    x, y = (int(value) for value in np.argwhere(world.masks[0]).mean(0)[::-1])
    own = {"segmenter": kind}
    settings = {"extends": "mock", "photo": {"ignore": [[x, y]]}}
    result = reconstruct(world.image, settings, backends=own)
    assert not result.people
    assert [one.reason for one in result.unposed] == ["not chosen"]
    assert any("1 not chosen" in note for note in result.notes)
    by_prompt = reconstruct(
        world.image, "mock", backends=own, people=PeoplePrompt(masks=world.masks[:1], ignored=True)
    )
    np.testing.assert_array_equal(by_prompt.scene.points, result.scene.points)
    with pytest.raises(NoPersonError, match="at point 1"):
        reconstruct(world.image, {"extends": "mock", "photo": {"ignore": [[1, 1]]}}, backends=own)


def test_people_are_required_after_those_who_are_ignored(world):
    places = [np.argwhere(mask).mean(0)[::-1].round().tolist() for mask in world.masks]
    photo = {"ignore": places, "require_people": True}
    with pytest.raises(NoPersonError, match="left out"):
        reconstruct(world.image, {"extends": "mock", "photo": photo})


def test_people_are_chosen_or_ignored():
    photo = {"person": [[1, 1]], "ignore": [[2, 2]]}
    with pytest.raises(ConfigError, match="only one"):
        load_config(preset="mock", flags={"flags": {"photo": photo}})
    with pytest.raises(ConfigError, match="only one"):
        reconstruct(
            np.zeros((72, 96, 3), np.uint8),
            {"extends": "mock", "photo": {"ignore": [[2, 2]]}},
            people=PeoplePrompt(points=((1, 1),)),
        )


@pytest.mark.parametrize("kind", [backends.MockSegmenter, Prompted])
def test_a_run_reconstructs_the_chosen_person(world, kind):
    y, x = np.argwhere(world.masks[0])[len(np.argwhere(world.masks[0])) // 2]
    own = {"segmenter": kind}
    result = reconstruct(world.image, "mock", backends=own, people=PeoplePrompt(points=((x, y),)))
    assert [bool(person.mask[y, x]) for person in result.people] == [True]
    by_config = load_config(preset="mock", overrides=["photo.person=[[1, 1]]"])
    with pytest.raises(NoPersonError, match=r"no person was found at point 1 \(1, 1\)"):
        reconstruct(world.image, by_config, backends=own)


def test_a_segmenter_that_takes_prompts_has_to_obey_them(world):
    prompt = PeoplePrompt(boxes=(tuple(map(float, world.boxes[0])),))
    with pytest.raises(
        BackendOutputError, match="one person per prompt is needed, 1 in all, got 0"
    ):
        reconstruct(world.image, "mock", backends=changed(Prompted, without_people), people=prompt)
