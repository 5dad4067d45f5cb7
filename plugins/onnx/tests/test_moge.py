"""MoGe-2: what is fed and read, a network that knows the world, and one run for two interfaces."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import CameraTrust, Hints, Intrinsics
from physic_onnx.moge import Moge2Depth, Moge2Pointmap, network_input_size
from physic_testing.worlds import load_world

SHIFT = -0.7
UNIT = 2.3
"""What the stand-in's z lacks, and metres in one of its units."""


@pytest.fixture
def backend_of(bound, stand_in_network):
    """``backend_of(Adapter, answer)``: the adapter with a network that answers so."""

    def make(kind, answer, **options):
        inputs = {"image": ("batch_size", 3, "height", "width"), "num_tokens": ()}
        return bound(kind, stand_in_network(inputs, answer), **options)

    return make


def plane(feed, *, slope=1.0, mask=1.0, scale=1.5):
    """A wall, tilted or flat, in a picture of the size that is fed."""
    height, width = feed["image"].shape[2:]
    v, u = np.mgrid[:height, :width]
    z = 2 + slope * u / width
    points = np.stack([(u - (width - 1) / 2) / 70 * z, (v - (height - 1) / 2) / 70 * z, z], -1)
    return {"points": points[None], "mask": np.full((1, height, width), mask), "scale": [scale]}


PHOTO = np.full((60, 80, 3), [255, 51, 0], np.uint8)


def test_large_photo_is_reduced_with_all_of_its_pixels(backend_of):
    """The graph itself would pick some: stripes of one pixel of red have to become half of it. It
    is fed RGB from 0 to 1.
    """
    stripes = np.zeros((1200, 1600, 3), np.uint8)
    stripes[:, ::2, 0] = 255
    backend = backend_of(Moge2Pointmap, plane, tokens=1200)
    backend.infer(stripes, Hints())
    fed = backend.network.fed["image"]
    assert fed.shape == (1, 3, 420, 560)
    assert np.abs(fed[0, :, :, 2:-2] - np.reshape([0.5, 0, 0], (3, 1, 1))).max() < 0.1


def true_answer(world, feed, *, people):
    """What a perfect MoGe-2 says of a photo that is not reduced: true points without their shift,
    in a unit of its own.
    """
    points = world.points(people=people)
    return {
        "points": np.nan_to_num(points / UNIT, nan=1.0)[None] - [0, 0, SHIFT],
        "mask": np.isfinite(points[..., 2])[None],
        "scale": [UNIT],
    }


@pytest.fixture
def infer(backend_of):
    """Asks an adapter whose network knows a world about its photo, with or without people."""

    def ask(kind, world, hints=None, *, people=False):
        backend = backend_of(kind, partial(true_answer, world, people=people))
        return backend.infer(world.image if people else world.empty_image, hints or Hints())

    return ask


@pytest.mark.parametrize(
    ("name", "size", "guess"),
    [
        ("walk_portrait", (332, 249), None),
        ("stand_indoors", (320, 240), 900.0),
    ],
)
def test_depth_and_focal_length_are_recovered_whatever_camera_is_guessed(infer, name, size, guess):
    world = load_world(name, size)
    camera = guess and Intrinsics.from_focal(guess, *size, "", CameraTrust.GUESSED)
    depth_map = infer(Moge2Depth, world, Hints(intrinsics=camera))
    np.testing.assert_allclose(depth_map.depth, world.empty_depth, rtol=1e-5)
    camera = depth_map.intrinsics
    assert camera.fx == camera.fy == pytest.approx(world.intrinsics.fx, rel=1e-5)
    height, width = world.depth.shape
    assert (camera.cx, camera.cy) == ((width - 1) / 2, (height - 1) / 2)
    assert camera.source == "MoGe-2"


def test_sky_is_not_a_surface(infer):
    world = load_world("outdoor_steps", (320, 240))
    sky = ~np.isfinite(world.empty_depth)
    assert sky.any()
    np.testing.assert_array_equal(np.isnan(infer(Moge2Depth, world).depth), sky)
    pointmap = infer(Moge2Pointmap, world)
    np.testing.assert_array_equal(pointmap.valid, ~sky)
    assert np.isnan(pointmap.points[sky]).all()


def test_a_flat_wall_gives_no_focal_length_and_a_note(backend_of):
    answer = partial(plane, slope=0.0, mask=0.51)
    pointmap = backend_of(Moge2Pointmap, answer).infer(PHOTO, Hints())
    assert pointmap.unknown == "scale_shift"
    assert "flat" in pointmap.intrinsics.source
    assert pointmap.intrinsics.guessed
    assert "70 px" in pointmap.notes[1]
    assert pointmap.valid.all()


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ({"mask": 0.5}, "0 valid points of 80 x 60"),
        *(({"scale": value}, "returned a scale of") for value in (0.0, -1.0, np.nan, np.inf)),
    ],
)
def test_an_answer_without_a_surface_or_a_scale_is_refused(backend_of, answer, words):
    with pytest.raises(BackendError, match=words):
        backend_of(Moge2Depth, partial(plane, **answer)).infer(PHOTO, Hints())


@pytest.mark.parametrize("tokens", [1200, 2500, 3600])
@pytest.mark.parametrize("size", [(1080, 1920), (3024, 4032), (4000, 2250), (1501, 1999)])
def test_the_network_resizes_nothing_of_what_it_gets(size, tokens):
    """By its forward pass it rounds sqrt(tokens / aspect) and sqrt(tokens * aspect) to rows and
    columns of patches.
    """
    height, width, asked = network_input_size(*size, tokens)
    aspect = width / height
    assert (14 * round((asked / aspect) ** 0.5), 14 * round((asked * aspect) ** 0.5)) == (
        height,
        width,
    )
    assert 0.85 * tokens <= asked <= tokens
    assert abs(np.log(aspect * size[0] / size[1])) < 0.01
