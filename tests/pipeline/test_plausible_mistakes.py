"""Results of backends that the interface allows and the photo contradicts: the backend is named."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from physic_core import Pipeline, reconstruct
from physic_core.backends.people import boxes_from_masks
from physic_mock import backends
from physic_mock.recognition import match_masks_to_world, recognise_world
from physic_testing.conformance.truth import true_wrists
from physic_testing.worlds import load_world
from tests.pipeline.mocks import changed

pytestmark = pytest.mark.usefixtures("few_steps")


def mistaken(kind, field, change):
    """A class like a mock, one field of whose results is changed."""
    return changed(
        kind,
        lambda found, *_: replace(found, **{field: np.float32(change(getattr(found, field)))}),
    )


DEPTH = backends.MockMetricDepth, "depth"
CONTACT = backends.MockContactPrior, "probability"
POINTS = backends.MockKeypointDetector, "points"
UNCACHED = {"extends": "mock", "run": {"cache": False}}


def with_wrists(hands, image, people, _, shift=0.0):
    found = recognise_world(image)
    wrists = true_wrists(found.world)[match_masks_to_world(found, people)]
    return replace(hands, wrists=np.float32(shift + (shift == 0) * wrists))


def with_corners(people, _):
    masks = people.masks.copy()
    masks[:, [0, 0, -1, -1], [0, -1, 0, -1]] = True
    return replace(people, masks=masks, boxes=boxes_from_masks(masks))


def filled_with(change):
    return changed(
        backends.MockInpainter,
        lambda picture, _, mask: np.where(mask[..., None], change(picture), picture),
    )


HANDS = backends.MockHandEstimator
RANDOM = np.random.default_rng(1)
SILENT = {
    "wrists are turned": changed(HANDS, partial(with_wrists, shift=1e-6)),
    "a finger is bent": mistaken(HANDS, "rotvecs", lambda r: 6 * r),
    "a finger is bent by": mistaken(HANDS, "rotvecs", lambda r: r + np.array([3.5, 0, 0])),
    "near anything": mistaken(*CONTACT, lambda p: p[:, RANDOM.permutation(p.shape[1])]),
    "sigmoid": mistaken(
        backends.MockKeypointDetector, "confidence", lambda c: 1 / (1 + np.exp(-c))
    ),
    "different depths": mistaken(*DEPTH, lambda z: np.round(8 * z) / 8),
    "red and blue": filled_with(lambda picture: picture[..., ::-1]),
    "its range": filled_with(lambda picture: picture // 2),
    "leaves the photo": changed(backends.MockInpainter, lambda _, photo, mask: photo.copy()),
    "four corners": changed(backends.MockSegmenter, with_corners),
    "in the boxes": mistaken(*POINTS, lambda points: points[..., ::-1]),
    "the boxes of people": mistaken(*POINTS, lambda points: points / 160),
    "two calls": mistaken(*DEPTH, lambda z: z * (1 + 0.02 * RANDOM.standard_normal(z.shape))),
}


@pytest.fixture(scope="module")
def walk():
    return load_world("walk", (160, 120))


@pytest.mark.parametrize("run", range(4))
def test_mistakes_that_checks_of_the_result_do_not_see_are_warnings(run, walk):
    """Of at most one backend for each interface in a run."""
    # people who reach into the corners hide the label of a world, and have boxes as large as it
    seen = Counter({backends.MockSegmenter.interface: 3})
    chosen = {}
    for words, backend in SILENT.items():
        (interface,) = backend
        if seen[interface] == run:
            chosen[words] = backend
        seen[interface] += 1
    both = {name: kind for backend in chosen.values() for name, kind in backend.items()}
    found = reconstruct(walk.image, UNCACHED, backends=both)
    for words, (interface,) in chosen.items():
        assert any(words in one and f"{interface} '" in one for one in found.warnings), words


def test_wrists_that_are_doubted_move_no_arm(walk):
    doubted = changed(HANDS, partial(with_wrists, shift=1e-6))
    without = changed(HANDS, lambda hands, *_: hands)
    one, other = (
        reconstruct(walk.image, UNCACHED, backends=hands).people[0].joints
        for hands in (doubted, without)
    )
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "wrong",
    [
        mistaken(*CONTACT, lambda p: np.repeat(p.sum(0, keepdims=True).clip(0, 1), len(p), 0)),
        changed(
            backends.MockBodyEstimator,
            lambda bodies, *_: replace(
                bodies, parameters=bodies.parameters[np.zeros(len(bodies.parameters), int)]
            ),
        ),
    ],
)
def test_one_answer_for_two_people_is_a_warning(wrong):
    found = reconstruct(load_world("sit_side_by_side", (160, 120)).image, UNCACHED, backends=wrong)
    assert any("two people" in one for one in found.warnings)


def test_the_result_of_the_last_photo_is_a_warning(walk):
    kept = []
    stale = changed(backends.MockMetricDepth, lambda depth, *_: kept.append(depth) or kept[0])
    with Pipeline(UNCACHED, backends=stale) as pipeline:
        pipeline(walk.image)
        found = pipeline(load_world("stand", (160, 120)).image)
    assert any("last photo" in one for one in found.warnings)


@pytest.mark.parametrize("name", ["walk", "sit_side_by_side"])
def test_backends_without_a_mistake_and_without_a_stamp_raise_no_doubt(name):
    mocks = {kind.interface: kind for kind in (getattr(backends, n) for n in backends.__all__)}
    same = {interface: type("Mine", (kind,), {}) for interface, kind in mocks.items()}
    same |= changed(HANDS, with_wrists)
    found = reconstruct(load_world(name, (160, 120)).image, UNCACHED, backends=same)
    assert not [
        one for one in found.warnings if one.startswith(tuple(f"{name} '" for name in same))
    ]


BODIES = backends.MockBodyEstimator
FAR_FROM_OTHERS = [
    mistaken(*POINTS, lambda points: points + np.array([0, 10])),
    changed(
        BODIES,
        lambda bodies, *_: replace(
            bodies,
            parameters=replace(
                bodies.parameters,
                global_orient=bodies.parameters.global_orient * np.float32([1, 0, 0]),
            ),
        ),
    ),
    changed(
        backends.MockPersonObserver,
        lambda said, *_: replace(said, child=np.full_like(said.child, 0.95), child_share=0.1),
    ),
    changed(backends.MockRelativePointmap, lambda pointmap, *_: replace(pointmap, up=-pointmap.up)),
    mistaken(*DEPTH, lambda z: 1.6 * z),
    mistaken(
        backends.MockPersonObserver, "touch", lambda touch: touch[:, [2, 3, 0, 1, *range(4, 10)]]
    ),
]


@pytest.mark.parametrize("wrong", FAR_FROM_OTHERS)
def test_a_backend_that_never_passed_the_kit_is_named_where_a_mark_is_lower(wrong, walk):
    """Children with the height of adults, a shift, a mirrored body, a roof for a floor, a scale,
    and hands for feet, of which no check fails.
    """
    (interface,) = wrong
    found = reconstruct(walk.image, UNCACHED, backends=wrong)
    assert any(f"{interface} '" in one for one in found.warnings), found.warnings


def test_a_backend_is_asked_twice_until_it_has_passed_the_kit(walk, monkeypatch):
    calls = []
    counted = changed(backends.MockMetricDepth, lambda depth, *_: calls.append(1) or depth)
    with Pipeline(UNCACHED, backends=counted) as pipeline:
        pipeline(walk.image)
        assert len(calls) == 2
        pipeline(walk.image)
        assert len(calls) == 3
    monkeypatch.setattr("physic_core.pipeline.stage_caller.has_passed_kit", lambda *_: True)
    reconstruct(walk.image, UNCACHED, backends=counted)
    assert len(calls) == 4


@pytest.mark.parametrize(
    ("wrong", "words", "check", "placed"),
    [
        (mistaken(*DEPTH, lambda z: 1000 * z), "is its unit millimeters", "depth_scale", 1),
        (mistaken(*DEPTH, lambda z: z[:, ::-1]), "mirrored", "depth_order", 0),
        (mistaken(*CONTACT, lambda p: 1 - p), "are they inverted", None, 1),
        (mistaken(*CONTACT, np.zeros_like), "0 everywhere", None, 1),
    ],
)
def test_a_plausible_mistake_is_a_warning_that_names_the_backend(
    world, wrong, words, check, placed
):
    found = reconstruct(world.image, "mock", backends=wrong)
    (interface,) = wrong
    (warning,) = (text for text in found.warnings if words in text)
    assert f"{interface} '" in warning
    assert [one.name for one in found.checks if one.failed and one.person is None] == (
        [check] if check else []
    )
    assert found.usable["place"] == placed  # a depth of another scale than people is not followed
