"""Depth Anything V2 relative, V2 metric and 3: the exports that are about, and the real small
network.
"""

from __future__ import annotations

import math
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import Hints, Intrinsics
from physic_networks.pictures import resize_map
from physic_onnx.depth_anything import (
    OTHER,
    PUBLISHED,
    VIEWS,
    DepthAnything,
    preprocess,
)


def ramp(height, width):
    """Red grows to the right, green upwards, blue is constant."""
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0] = np.linspace(20, 220, width)[None, :]
    image[..., 1] = np.linspace(200, 30, height)[:, None]
    image[..., 2] = 77
    return image


IMAGENET_MEAN = np.array([0.485, 0.456, 0.406])
IMAGENET_STD = np.array([0.229, 0.224, 0.225])
FREE = ("batch_size", 3, "height", "width")
FREE_MAP = ("batch_size", "height", "width")
ONE_PHOTO = {
    "takes": "image",
    "gives": "depth",
    "shape": (1, 3, 252, 252),
    "map_shape": (1, 252, 252),
}
SKYLESS = np.zeros((1, 1, 252, 252))


@pytest.fixture
def opened(bound, stand_in_network):
    """A network that answers the red of its input plus 4, or a map; its other outputs are given."""

    def make(
        name="model.onnx",
        takes="pixel_values",
        gives="predicted_depth",
        shape=FREE,
        map_shape=FREE_MAP,
        values=None,
        further=None,
        **options,
    ):
        further = further or {}

        def answer(fed):
            red = fed[takes][..., 0, :, :]
            return {
                gives: red + 4 if values is None else np.reshape(values, (1, *values.shape))
            } | further

        outputs = {gives: ("float32", map_shape)}
        outputs |= {other: ("float32", np.shape(value)) for other, value in further.items()}
        network = stand_in_network({takes: ("float32", shape)}, answer, outputs)
        network.name = name
        return bound(DepthAnything, network, **options)

    return make


@pytest.fixture
def metric_file(graph, node, tmp_path):
    """A file of a metric network, whose map is ``most`` times the sigmoid of its red."""

    def write(name, shape=FREE, map_shape=FREE_MAP, most=20):
        nodes = [
            node("Gather", ["pixel_values", "red"], ["plane"], axis=1),
            node("Sigmoid", ["plane"], ["share"]),
            node("Mul", ["share", "most"], ["predicted_depth"]),
        ]
        ports = {"pixel_values": ("float32", shape)}, {"predicted_depth": ("float32", map_shape)}
        constants = {"red": np.int64(0), "most": np.float32(most)}
        return graph(tmp_path / name, *ports, nodes, constants)

    return write


def normalised(image):
    return (image[..., 0] / 255 - IMAGENET_MEAN[0]) / IMAGENET_STD[0]


class TestExports:
    """Names, sizes and values of the files that are about."""

    @pytest.mark.parametrize(
        ("takes", "gives", "signature"),
        [
            ("pixel_values", "predicted_depth", PUBLISHED),
            ("input", "output", PUBLISHED),
            ("l_x_", "select_36", OTHER),
        ],
    )
    def test_ports_are_known_by_their_names_or_their_place(self, opened, takes, gives, signature):
        backend = opened(takes=takes, gives=gives)
        assert backend.network.signature == signature
        backend.infer(ramp(196, 252), Hints())

    def test_sky_has_no_point(self, opened):
        values = np.linspace(3, 1, 518)[:, None] * np.ones((1, 518))
        values[:100] = 0
        answer = opened(values=values).infer(np.zeros((259, 259, 3), np.uint8), Hints())
        assert not answer.valid[:48].any()
        assert answer.valid[52:].all()
        assert np.isfinite(answer.points).all()

    def test_a_metric_file_is_known_by_its_sigmoid_and_a_fixed_size_squashes_the_photo(
        self, metric_file, loaded
    ):
        image = ramp(100, 300)
        path = metric_file("model.onnx", (1, 3, 70, 70), (1, 70, 70))
        answer = loaded(DepthAnything, path).infer(image, Hints())
        assert answer.unknown == "scale"
        metres = 1 / (1 + np.exp(-normalised(image)))
        z = (answer.points[..., 2] * np.median(metres))[:, 5:-5]
        np.testing.assert_allclose(z, metres[:, 5:-5], rtol=0.03)
        assert "70 x 70 px only" in answer.notes[-1]

    def test_depths_near_the_largest_depth_of_a_metric_network_are_unknown(
        self, metric_file, loaded
    ):
        image = np.zeros((70, 70, 3), np.uint8)
        image[:, 35:] = 255
        path = metric_file("depth_anything_v2_metric_indoor.onnx", most=21.8)  # 2.3 and 19.7 m
        valid = loaded(DepthAnything, path).infer(image, Hints()).valid
        assert valid[:, :34].all()
        assert not valid[:, 36:].any()

    def test_map_of_another_size_than_the_input_is_brought_to_the_photo(self, opened):
        """Trap: exports whose output keeps the size of the export, whatever they are fed."""
        backend = opened(values=np.linspace(1, 2, 28)[:, None] * np.ones((1, 28)))
        answer = backend.infer(ramp(140, 280), Hints())
        assert answer.unknown == "inverse_scale_shift"
        camera, z = answer.intrinsics, answer.points[..., 2]
        x, y = (np.arange(280) - camera.cx) / camera.fx, (np.arange(140) - camera.cy) / camera.fy
        np.testing.assert_allclose(answer.points[..., 0], z * x, atol=1e-6)
        np.testing.assert_allclose(answer.points[..., 1], z * y[:, None], atol=1e-6)
        disparity = 1 / z[:, 0]
        rows = np.clip(1 + (np.arange(140) + 0.5) / 140 * 28 / 27 - 0.5 / 27, 1, 2)
        np.testing.assert_allclose(disparity * np.median(rows), rows, atol=1e-5)


class TestNormalisation:
    def test_file_that_normalises_itself_is_fed_0_to_255(self, opened):
        """Trap: such a file has the same names; its sides are called H and W, and it takes one
        photo.
        """
        image = ramp(196, 252)
        own = {"takes": "image", "gives": "depth", "shape": (1, 3, "H", "W")}
        disparity = image[..., 0] + 4.0
        z = opened(**own, map_shape=(1, "H", "W")).infer(image, Hints()).points[..., 2]
        np.testing.assert_allclose(z * disparity, np.median(disparity), rtol=0.02)

    @pytest.mark.parametrize("size", [(600, 800), (97, 131)])
    def test_photo_is_prepared_as_by_the_librarys_own_processor(self, size):
        """Trap: bicubic with antialiasing, multiples of 14, the side that changes less becomes
        518.
        """
        pytest.importorskip("transformers")
        from transformers.models.dpt.image_processing_pil_dpt import DPTImageProcessorPil

        from physic_onnx.depth_maps import input_size_least_scaling

        processor = DPTImageProcessorPil(
            size={"height": 518, "width": 518},
            keep_aspect_ratio=True,
            ensure_multiple_of=14,
            image_mean=list(IMAGENET_MEAN),
            image_std=list(IMAGENET_STD),
        )
        image = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
        wanted = np.asarray(processor(image, return_tensors="np")["pixel_values"])
        fed = preprocess(image, *input_size_least_scaling(*size, 518))
        assert fed.shape == wanted.shape
        np.testing.assert_allclose(fed, wanted, atol=1e-5)


VERSION_3 = {"shape": ("b", "n", 3, "h", "w"), "map_shape": ("b", "n", "h", "w")}


@pytest.mark.parametrize(
    ("ports", "sizes"),
    [
        ({}, {(720, 1280): (518, 924), (1280, 720): (924, 518), (97, 131): (378, 518)}),
        ({}, {(800, 4800): (392, 2422)}),  # 5000 patches at most
        (VERSION_3, {(720, 1280): (280, 504), (640, 480): (504, 378)}),
    ],
)
def test_free_sizes_keep_the_aspect_in_multiples_of_14(opened, ports, sizes):
    """The short side becomes 518 of a larger photo and the long one of a smaller; the long one 504
    in version 3.
    """
    backend = opened(**ports)
    for (height, width), seen in sizes.items():
        backend.infer(ramp(height, width), Hints())
        assert backend.network.network.fed["pixel_values"].shape[-2:] == seen


class TestVersion3:
    """Depth Anything 3: depth, and of some files a camera, a confidence, a sky."""

    def test_the_output_of_several_views_is_depth_and_not_disparity(self, opened):
        """Trap: the names are those of V2, and larger is farther."""
        image = ramp(252, 252)
        backend = opened("da.onnx", **VERSION_3)
        assert backend.network.signature == VIEWS
        answer = backend.infer(image, Hints())
        assert answer.unknown == "scale"
        depth = normalised(image) + 4
        np.testing.assert_allclose(answer.points[..., 2] / depth, 1 / np.median(depth), rtol=0.01)

    @pytest.mark.parametrize(
        ("name", "further", "answers", "unknown"),
        [
            ("other.onnx", {"depth_conf": np.zeros((1, 1, 2, 2))}, "auto", "scale"),
            ("other.onnx", {"intrinsics": np.eye(3)[None, None]}, "auto", "scale"),
            ("other.onnx", {"sky": SKYLESS}, "auto", "scale_shift"),
            ("da3metric-large.onnx", {"sky": SKYLESS}, "auto", "scale"),
            ("depth-anything-v3-small.onnx", {}, "auto", "scale_shift"),
            ("depth-anything-v3-small.onnx", {}, "disparity", "inverse_scale_shift"),
            ("other.onnx", {}, "auto", "inverse_scale_shift"),
            ("other.onnx", {}, "depth", "scale_shift"),
        ],
    )
    def test_kind_is_recognised_by_further_outputs_name_or_option(
        self, opened, name, further, answers, unknown
    ):
        image = ramp(252, 252)
        backend = opened(name, **ONE_PHOTO, further=further, answers=answers)
        answer = backend.infer(image, Hints(intrinsics=Intrinsics.from_focal(200.0, 252, 252)))
        assert answer.unknown == unknown
        farther = np.corrcoef(answer.points[126, :, 2], image[126, :, 0])[0, 1]
        assert (farther > 0.9) if unknown != "inverse_scale_shift" else (farther < -0.9)

    def test_its_camera_is_brought_to_the_photo(self, opened):
        """Trap: the matrix is of the network's picture, and counts from its corner."""
        matrix = np.array([[200.0, 0, 126], [0, 300.0, 126], [0, 0, 1]])
        backend = opened(**ONE_PHOTO, further={"intrinsics": matrix[None, None]})
        answer = backend.infer(ramp(504, 1008), Hints())
        camera = answer.intrinsics
        found = (camera.fx, camera.fy, camera.cx, camera.cy)
        assert found == pytest.approx((800.0, 600.0, 503.5, 251.5))
        assert camera.source == "Depth Anything 3"
        assert "800 px" in answer.notes[0]

    def test_sky_is_where_the_score_is_high(self, opened):
        sky = SKYLESS.copy()
        sky[..., :100, :] = 0.9
        sky[..., 100:110, :] = 0.29
        answer = opened(**ONE_PHOTO, further={"sky": sky}).infer(ramp(252, 252), Hints())
        assert not answer.valid[:100].any()
        assert answer.valid[100:].all()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros((2, 3, 4)), r"predicted_depth of shape \(1, 2, 3, 4\): one map"),
        (np.full((2, 3), 0.9741), r"predicted_depth = 0\.9741 for every pixel"),
    ],
)
def test_several_maps_and_a_constant_map_are_refused(opened, values, words):
    with pytest.raises(BackendError, match=words):
        opened(values=values).infer(ramp(28, 28), Hints())


def test_an_unknown_camera_becomes_a_default_and_is_noted(opened):
    answer = opened().infer(ramp(196, 140), Hints())
    assert answer.intrinsics.fx == pytest.approx(98 / math.tan(math.radians(55.5 / 2)))
    assert "55.5 degrees" in answer.intrinsics.source
    assert answer.intrinsics.guessed
    assert "default" in answer.notes[0]


def _packaged():
    """The real small network, where metricbody-embedded is installed."""
    try:
        path = (
            Path(str(resources.files("physic_embedded")))
            / "weights"
            / "depth_anything_v2_vits.onnx"
        )
    except ModuleNotFoundError:
        return None
    return path if path.is_file() else None


PHOTO = Path(__file__).parents[3] / "examples" / "basketball.png"


@pytest.mark.skipif(
    _packaged() is None,
    reason="metricbody-embedded, whose wheel holds the real network, is not installed",
)
@pytest.mark.skipif(not PHOTO.is_file(), reason="examples/basketball.png is not here")
class TestRealNetwork:
    """Depth Anything V2 small itself."""

    @pytest.fixture
    def photo(self):
        from PIL import Image

        with Image.open(PHOTO) as opened:
            return np.asarray(opened.convert("RGB"))[:, 80:560]

    def test_disparity_is_that_of_the_embedded_backend(self, photo, loaded):
        from physic_embedded.networks.depth_anything import predict_disparity
        from physic_networks.onnx_sessions import open_session

        session = open_session(_packaged(), threads=0, device="cpu", broken="")
        # A square photo has whole patches: the embedded backend pads others, and this one stretches
        # them.
        own = predict_disparity(session, photo, short_side=518)
        answer = loaded(DepthAnything, _packaged()).infer(photo, Hints())
        own = resize_map(own, *photo.shape[:2])
        here = 1 / answer.points[..., 2]
        here *= np.median(own[answer.valid]) / np.median(here[answer.valid])
        spread = np.percentile(own, 99) - np.percentile(own, 1)
        off = np.abs(here - own)[answer.valid] / spread
        assert answer.valid.mean() > 0.9
        assert np.median(off) < 0.01, f"{np.median(off):.4f}"
        assert np.percentile(off, 95) < 0.05, f"{np.percentile(off, 95):.4f}"
