"""MoGe-2: what is fed and read, a network that knows the world, and one look for two interfaces."""

from __future__ import annotations

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import CameraTrust, Hints, Intrinsics
from physic_onnx.moge import Moge2Depth, Moge2Pointmap, MogeOptions
from physic_onnx.moge_network import network_input_size
from physic_testing.worlds import load_world

IMAGE_IN = ("float32", ("batch_size", 3, "height", "width"))
TOKENS_IN = ("int64", ())
INPUTS = {"image": IMAGE_IN, "num_tokens": TOKENS_IN}
POINTS_OUT = ("float32", ("batch_size", "height", "width", 3))
NORMAL_OUT = ("float32", ("batch_size", "height", "width", 3))
MASK_OUT = ("float32", ("batch_size", "height", "width"))
SCALE_OUT = ("float32", ("batch_size",))

SHIFT = -0.7
UNIT = 2.3
"""What the stand-in's z lacks, and metres in one of its units."""


def outputs_called(scale):
    return {"points": POINTS_OUT, "normal": NORMAL_OUT, "mask": MASK_OUT, scale: SCALE_OUT}


@pytest.fixture
def answering(stand_in_network):
    """``answering(Adapter, answer, **options)``: the adapter with a network that answers so."""

    def make(kind, answer, inputs=INPUTS, scale="scale", **options):
        network = stand_in_network(inputs, answer, outputs_called(scale))
        backend = kind(MogeOptions(**options))
        backend._network = backend.runner.open(id(network), lambda: network)
        return backend

    return make


class TestContract:
    """What is fed, and what is read."""

    @pytest.fixture
    def raw(self, answering):
        """What is read of a MoGe-2 whose points carry what it was fed: x, y, z = R, G, B of the
        image; the scale is the tokens.
        """

        def ask(image=np.full((20, 30, 3), 90, np.uint8), mask=0.9, scale="scale", **more):  # noqa: B008
            def answer(feed):
                points = feed["image"].transpose(0, 2, 3, 1)
                tokens = np.reshape(feed["num_tokens"], 1)
                sure = np.full(points.shape[:3], mask)
                return {"points": points, "normal": points, "mask": sure, scale: tokens}

            backend = answering(Moge2Pointmap, answer, scale=scale, **more)
            return backend.runner.run(backend.network, image, backend.options.tokens)

        return ask

    def test_image_is_fed_as_rgb_from_0_to_1_without_mean_and_deviation(self, raw):
        image = np.full((20, 30, 3), [255, 51, 0], np.uint8)
        image[3, 7, 2] = 102
        points = raw(image).points
        np.testing.assert_allclose(points[..., :2] - [1, 0.2], 0, atol=1e-6)
        assert points[3, 7, 2] == pytest.approx(0.4, abs=1e-6)

    @pytest.mark.parametrize("scale", ["scale", "metric_scale", "whatever"])
    def test_fourth_output_is_the_scale_by_either_name_or_by_its_place(self, raw, scale):
        assert raw(scale=scale, tokens=1500).scale == 1500

    @pytest.mark.parametrize(("dtype", "shape"), [("int64", (1,)), ("int32", ())])
    def test_number_of_tokens_has_the_dimensions_that_the_file_says(self, raw, dtype, shape):
        inputs = {"image": IMAGE_IN, "num_tokens": (dtype, shape)}
        assert raw(inputs=inputs, tokens=1200).scale == 1200

    def test_large_photo_is_reduced_with_all_of_its_pixels(self, raw):
        """The graph itself would pick some: stripes of one pixel have to become grey."""
        stripes = np.zeros((1200, 1600, 3), np.uint8)
        stripes[:, ::2] = 255
        points = raw(stripes, tokens=1200).points
        assert points.shape == (420, 560, 3)
        assert np.abs(points[:, 2:-2] - 0.5).max() < 0.1

    @pytest.mark.parametrize(("mask", "is_surface"), [(0.51, True), (0.5, False)])
    def test_surface_is_where_the_mask_is_above_one_half(self, raw, mask, is_surface):
        assert (raw(mask=mask).mask == is_surface).all()

    def test_file_for_photos_of_one_size_is_refused(self, constant_graph, loaded, tmp_path):
        fixed = {"image": ("float32", (1, 3, 9, 9)), "num_tokens": TOKENS_IN}
        answer = {"points": np.ones((1, 9, 9, 3)), "mask": np.ones((1, 9, 9)), "scale": [1]}
        path = constant_graph(tmp_path / "model.onnx", fixed, **answer)
        with pytest.raises(BackendError, match="exported for photos of one size"):
            loaded(Moge2Depth, path)


def true_answer(world, feed, *, people):
    """What a perfect MoGe-2 says of a photo that is not reduced: true points without their shift,
    in a unit of its own.
    """
    points = world.points(people=people)
    return {
        "points": np.nan_to_num(points / UNIT, nan=1.0)[None] - [0, 0, SHIFT],
        "normal": np.zeros((1, *points.shape)),
        "mask": np.isfinite(points[..., 2])[None],
        "scale": [UNIT],
    }


@pytest.fixture
def infer(answering):
    """Asks an adapter whose network knows a world about its photo, with or without people."""

    def ask(kind, world, hints=None, *, people=False, **options):
        backend = answering(kind, partial(true_answer, world, people=people), **options)
        return backend.infer(world.image if people else world.empty_image, hints or Hints())

    return ask


class TestWorld:
    """Known answers, from a network that is perfect in its own space."""

    @pytest.mark.parametrize(
        ("name", "size", "guess"),
        [
            ("stand_indoors", (320, 240), None),
            ("walk_portrait", (332, 249), None),
            ("stand_indoors", (320, 240), 900.0),
        ],
    )
    def test_depth_and_focal_length_are_recovered_whatever_camera_is_guessed(
        self, infer, name, size, guess
    ):
        world = load_world(name, size)
        camera = guess and Intrinsics.from_focal(guess, *size, "", CameraTrust.GUESSED)
        found = infer(Moge2Depth, world, Hints(intrinsics=camera))
        np.testing.assert_allclose(found.depth, world.empty_depth, rtol=1e-5)
        assert (
            found.intrinsics.fx
            == found.intrinsics.fy
            == pytest.approx(world.intrinsics.fx, rel=1e-5)
        )
        height, width = world.depth.shape
        assert (found.intrinsics.cx, found.intrinsics.cy) == ((width - 1) / 2, (height - 1) / 2)
        assert found.intrinsics.source == "MoGe-2"

    @pytest.mark.parametrize("source", ["", "EXIF"])
    def test_point_map_leaves_the_unit_to_the_metric_depth_and_keeps_a_given_camera(
        self, infer, source
    ):
        world = load_world("stand_indoors", (320, 240))
        given = replace(world.intrinsics, source=source) if source else None
        found = infer(Moge2Pointmap, world, Hints(intrinsics=given), people=True)
        np.testing.assert_allclose(
            found.points * UNIT, world.points(people=True), rtol=1e-4, atol=1e-4
        )
        assert found.unknown == "scale"
        assert given is None or found.intrinsics == given

    def test_sky_is_not_a_surface(self, infer):
        world = load_world("outdoor_steps", (320, 240))
        sky = ~np.isfinite(world.empty_depth)
        assert sky.any()
        depth = infer(Moge2Depth, world).depth
        np.testing.assert_array_equal(np.isnan(depth), sky)
        found = infer(Moge2Pointmap, world)
        np.testing.assert_array_equal(found.valid, ~sky)
        assert np.isnan(found.points[sky]).all()


class TestOddAnswers:
    @pytest.fixture
    def constant(self, answering):
        """An adapter whose network always answers these points, this mask and this scale."""

        def make(kind, points, mask=1.0, scale=1.0):
            height, width = points.shape[:2]
            answer = {
                "points": points[None],
                "normal": points[None],
                "mask": np.full((1, height, width), mask),
                "scale": [scale],
            }
            return answering(kind, answer), np.full((height, width, 3), 128, np.uint8)

        return make

    @pytest.fixture
    def wall(self):
        v, u = np.mgrid[:60, :80]
        return np.stack([(u - 39.5) / 70, (v - 29.5) / 70, np.ones((60, 80))], -1)

    def test_a_flat_wall_gives_no_focal_length_and_a_note(self, constant, wall):
        backend, photo = constant(Moge2Pointmap, wall)
        found = backend.infer(photo, Hints())
        assert found.unknown == "scale_shift"
        assert "flat" in found.intrinsics.source
        assert found.intrinsics.guessed
        assert "70 px" in found.notes[1]
        assert found.valid.all()

    def test_photo_of_nothing_but_sky_is_refused(self, constant, wall):
        backend, photo = constant(Moge2Depth, wall, mask=0.1)
        with pytest.raises(BackendError, match="0 valid points of 80 x 60"):
            backend.infer(photo, Hints())

    @pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
    def test_a_scale_that_is_not_a_positive_number_is_refused(self, constant, wall, scale):
        backend, photo = constant(Moge2Depth, wall, scale=scale)
        with pytest.raises(BackendError, match="returned a scale of"):
            backend.infer(photo, Hints())

    def test_answer_of_another_size_is_refused(self, constant, wall):
        backend, photo = constant(Moge2Depth, wall)
        with pytest.raises(BackendError, match=r"\(1, 60, 80, 3\)"):
            backend.infer(photo[::2, ::2].copy(), Hints())


@pytest.mark.parametrize(
    ("size", "tokens", "seen"),
    [
        ((240, 320), 1800, (240, 320, 1800)),
        ((3000, 4000), 1800, (504, 672, 36 * 48)),
        ((20, 30000), 1200, (13, 18783, 1200)),
    ],
)
def test_photo_is_reduced_to_whole_patches_and_never_enlarged(size, tokens, seen):
    assert network_input_size(*size, tokens) == seen


@pytest.mark.parametrize("tokens", [1200, 2500, 3600])
@pytest.mark.parametrize(
    "size", [(1080, 1920), (2000, 3000), (3024, 4032), (4000, 2250), (1439, 2560), (1501, 1999)]
)
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


# ---- both interfaces share one look at a photo


def slope(feed):
    """A tilted plane, whatever is shown."""
    v, u = np.mgrid[:48, :64]
    z = 2.0 + u / 64
    points = np.stack([(u - 31.5) / 60 * z, (v - 23.5) / 60 * z, z], -1)
    return {"points": points[None], "mask": np.ones((1, 48, 64)), "scale": [1.5]}


@pytest.fixture
def network(stand_in_network):
    return stand_in_network(INPUTS, slope, outputs_called("scale"))


@pytest.fixture
def opened(network):
    """Opens the file, and counts how often."""
    return Mock(side_effect=lambda: network)


@pytest.fixture
def photos():
    return np.random.default_rng(3).integers(0, 255, (3, 48, 64, 3), np.uint8)


def open_in(backend, identity, opener):
    """Load a backend as from a file."""
    backend.runner.members.add(backend)
    backend._network = backend.runner.open(identity, opener)


def backends(opener=None):
    """One of each interface, with settings that no other test has, and opened if it is given."""
    both = [kind(MogeOptions(threads=7)) for kind in (Moge2Pointmap, Moge2Depth)]
    for backend in both:
        if opener is not None:
            open_in(backend, "file", opener)
    return both


def test_both_interfaces_run_the_network_once_a_photo(network, opened, photos):
    pointmap, depth = backends(opened)
    inpainted, original, _ = photos
    scene = pointmap.infer(inpainted, Hints())
    pointmap.infer(original, Hints(intrinsics=scene.intrinsics))
    found = depth.infer(inpainted.copy(), Hints(intrinsics=scene.intrinsics))
    assert network.runs == 2
    assert opened.call_count == 1
    np.testing.assert_allclose(found.depth, 1.5 * scene.points[..., 2], rtol=1e-6)


def test_pointmap_closed_before_the_depth_is_loaded_leaves_it_the_answers(network, opened, photos):
    """As the pipeline does where memory is low."""
    pointmap, depth = backends()
    open_in(pointmap, "file", opened)
    pointmap.infer(photos[0], Hints())
    pointmap.close()
    open_in(depth, "file", opened)
    depth.infer(photos[0], Hints())
    assert network.runs == 1
    assert opened.call_count == 2


def test_last_one_to_close_drops_the_network_and_the_answers(network, opened, photos):
    pointmap, depth = backends(opened)
    depth.infer(photos[0], Hints())
    pointmap.close()
    depth.infer(photos[1], Hints())
    depth.close()
    with pytest.raises(BackendError, match="not loaded"):
        depth.infer(photos[0], Hints())
    open_in(depth, "file", opened)
    depth.infer(photos[0], Hints())
    assert network.runs == 3
    assert opened.call_count == 2
    depth.close()
    depth.close()


def test_threads_that_ask_the_same_wait_for_one_run(network, opened, photos):
    members = [backend for _ in range(3) for backend in backends(opened)]
    with ThreadPoolExecutor(len(members)) as pool:
        list(pool.map(lambda backend: backend.infer(photos[0], Hints()), members))
    assert network.runs == 1


def test_nothing_is_left_when_the_backends_are_gone(opened, photos):
    pointmap, depth = backends()
    runner = weakref.ref(depth.runner)
    open_in(depth, "file", opened)
    depth.infer(photos[0], Hints())
    del pointmap, depth
    gc.collect()
    assert runner() is None
