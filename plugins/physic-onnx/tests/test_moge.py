"""MoGe-2 against graphs of the published contract, and with a network that knows the world."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

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
def contract_graph(graph, node, tmp_path):
    """A MoGe-2 whose points carry what it was fed: x, y, z = R, G, B of the image; the scale is the
    tokens.
    """

    def build(name="model.onnx", inputs=INPUTS, outputs=None, mask=0.9):
        outputs = outputs_called("scale") if outputs is None else outputs
        points, normal, seen, scale = outputs
        nodes = [
            node("Transpose", ["image"], [points], perm=[0, 2, 3, 1]),
            node("Identity", [points], [normal]),
            node("ReduceMax", ["image"], ["bright"], axes=[1], keepdims=0),
            node("Mul", ["bright", "nothing"], ["dark"]),
            node("Add", ["dark", "how_sure"], [seen]),
            node("Cast", ["num_tokens"], ["count"], to=1),
            node("Reshape", ["count", "one"], [scale]),
        ]
        constants = {
            "nothing": np.float32(0),
            "how_sure": np.float32(mask),
            "one": np.array([1], np.int64),
        }
        return str(graph(tmp_path / name, inputs, outputs, nodes, constants))

    return build


class TestContract:
    """What is fed, and what is read, by a real onnxruntime on a graph of the published form."""

    def raw(self, path, image, **options):
        backend = Moge2Pointmap(MogeOptions(weights=path, **options))
        backend.load()
        try:
            return backend.runner.run(backend.network, image, backend.options.tokens)
        finally:
            backend.close()

    def test_image_is_fed_as_rgb_from_0_to_1_without_mean_and_deviation(self, contract_graph):
        image = np.zeros((20, 30, 3), np.uint8)
        image[..., 0] = 255
        image[..., 1] = 51
        image[3, 7, 2] = 102
        points = self.raw(contract_graph(), image).points
        np.testing.assert_allclose(points[..., 0], 1, atol=1e-6)
        np.testing.assert_allclose(points[..., 1], 0.2, atol=1e-6)
        assert points[3, 7, 2] == pytest.approx(0.4, abs=1e-6)

    @pytest.mark.parametrize("scale", ["scale", "metric_scale", "whatever"])
    def test_fourth_output_is_the_scale_by_either_name_or_by_its_place(self, contract_graph, scale):
        image = np.full((20, 30, 3), 90, np.uint8)
        assert (
            self.raw(contract_graph(outputs=outputs_called(scale)), image, tokens=1500).scale
            == 1500
        )

    @pytest.mark.parametrize(("dtype", "shape"), [("int64", ()), ("int64", (1,)), ("int32", ())])
    def test_number_of_tokens_has_the_dimensions_that_the_file_says(
        self, contract_graph, dtype, shape
    ):
        path = contract_graph(inputs={"image": IMAGE_IN, "num_tokens": (dtype, shape)})
        assert self.raw(path, np.full((20, 30, 3), 90, np.uint8), tokens=1200).scale == 1200

    def test_large_photo_is_reduced_with_all_of_its_pixels(self, contract_graph):
        """The graph itself would pick some: stripes of one pixel have to become grey."""
        stripes = np.zeros((1200, 1600, 3), np.uint8)
        stripes[:, ::2] = 255
        points = self.raw(contract_graph(), stripes, tokens=1200).points
        assert points.shape == (420, 560, 3)
        assert np.abs(points[:, 2:-2] - 0.5).max() < 0.1

    def test_surface_is_where_the_mask_is_above_one_half(self, contract_graph):
        image = np.full((20, 30, 3), 90, np.uint8)
        assert self.raw(contract_graph(mask=0.51), image).mask.all()
        assert not self.raw(contract_graph("other.onnx", mask=0.5), image).mask.any()

    def test_file_for_photos_of_one_size_is_refused(self, contract_graph):
        fixed = {"image": ("float32", (1, 3, 518, 518)), "num_tokens": TOKENS_IN}
        with pytest.raises(BackendError, match="exported for photos of one size"):
            Moge2Depth(MogeOptions(weights=contract_graph(inputs=fixed))).load()


def true_answer(world, feed, *, people):
    """What a perfect MoGe-2 says: true points without their shift, in a unit of its own, at the
    size of its feed.
    """
    height, width = feed["image"].shape[2:]
    depth = np.asarray(world.depth if people else world.empty_depth, float)
    rows, columns = depth.shape
    v = (np.arange(height) + 0.5) * rows / height - 0.5
    u = (np.arange(width) + 0.5) * columns / width - 0.5
    grid = np.meshgrid(v, u, indexing="ij")
    # Points are asked for between pixels: they are found again on their rays, the depth being that
    # of the nearest one.
    z = map_coordinates(depth, grid, order=0, mode="nearest")
    sky = ~np.isfinite(z)
    camera = world.intrinsics
    rays = [(grid[1] - camera.cx) / camera.fx, (grid[0] - camera.cy) / camera.fy, np.ones_like(z)]
    points = np.stack(rays, -1) * np.where(sky, 1.0, z)[..., None] / UNIT
    points[..., 2] -= SHIFT
    return {
        "points": points[None],
        "normal": np.zeros((1, height, width, 3)),
        "mask": (~sky).astype(float)[None],
        "scale": [UNIT],
    }


@pytest.fixture
def answering(stand_in_network):
    """``answering(Adapter, answer, **options)``: the adapter with a network that answers so."""

    def make(kind, answer, **options):
        network = stand_in_network(INPUTS, outputs_called("scale"), answer)
        backend = kind(MogeOptions(**options))
        backend._network = backend.runner.open(id(network), lambda: network)
        return backend

    return make


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
            return answering(kind, lambda feed: answer), np.full((height, width, 3), 128, np.uint8)

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
