"""DepthPro against graphs of both contracts, and against a network that knows the world."""

from __future__ import annotations

import math

import numpy as np
import pytest

from physic_core.errors import BackendError, WeightsMissingError
from physic_core.types import CameraTrust, Hints, Intrinsics
from physic_onnx.depth_pro import INVERSE, METRES, DepthPro, preprocess

from .depth_maps_of_worlds import at, expect_picture, ramp

SIDE = 1536
PICTURE_IN = {"pixel_values": ("float32", ("batch_size", 3, SIDE, SIDE))}
DEPTH_OUT = ("float32", ("batch_size", SIDE, SIDE))


@pytest.fixture
def contract_graph(graph, node, tmp_path):
    """DepthPro whose map is its input's red * 2 + 3, and whose focal length or angle is given."""

    def build(second: str = "focallength_px", number: float = 1200.0, shape=("batch_size", 1), channel: int = 0) -> str:
        nodes = [
            node("Gather", ["pixel_values", "channel"], ["seen"], axis=1),
            node("Mul", ["seen", "two"], ["twice"]),
            node("Add", ["twice", "three"], ["predicted_depth"]),
            node("Identity", ["given"], [second]),
        ]
        constants = {
            "channel": np.array(channel, np.int64),
            "two": np.float32(2),
            "three": np.float32(3),
            "given": np.full(tuple(1 for _ in shape), number, np.float32),
        }
        outputs = {"predicted_depth": DEPTH_OUT, second: ("float32", shape)}
        return str(graph(tmp_path / f"{second}{channel}{len(shape)}.onnx", PICTURE_IN, outputs, nodes, constants))

    return build


def graph_value(image: np.ndarray, channel: int = 0) -> np.ndarray:
    """What the contract graph makes of a channel, at the photo's size."""
    return (image[..., channel] / 127.5 - 1) * 2 + 3


class TestContract:
    def test_export_of_the_torch_class_answers_canonical_inverse_depth(self, contract_graph, loaded):
        """Trap: metres are focal / (width * raw), focal from the horizontal angle in degrees over the photo's width."""
        image = ramp(96, 128)
        backend = loaded(DepthPro, contract_graph("field_of_view", 60.0, ("batch_size",)))
        assert backend.loaded().signature == INVERSE
        answer = backend.infer(image, Hints())
        focal = 0.5 * 128 / math.tan(math.radians(30))
        assert answer.intrinsics.fx == pytest.approx(focal)
        np.testing.assert_allclose(answer.depth, focal / (128 * graph_value(image)), rtol=0.01)

    @pytest.mark.parametrize("shape", [("batch_size",), ("batch_size", 1)])
    def test_focal_length_is_in_px_of_the_wide_square(self, contract_graph, shape, loaded):
        """Trap: 1200 px of 1536 are 100 px of a photo 128 px wide; the output has one axis or two."""
        backend = loaded(DepthPro, contract_graph(shape=shape))
        assert backend.loaded().signature == METRES
        camera = backend.infer(ramp(96, 128), Hints()).intrinsics
        assert (camera.fx, camera.fy) == (pytest.approx(100.0), pytest.approx(100.0))
        assert (camera.cx, camera.cy, camera.width, camera.height) == (63.5, 47.5, 128, 96)

    @pytest.mark.parametrize("second", ["focallength_px", "field_of_view"])
    def test_known_focal_length_scales_the_depth(self, contract_graph, second, loaded):
        """Trap: it cannot be fed. Depth is proportional to it, in both forms."""
        image = ramp(96, 128)
        number = 1200.0 if second == "focallength_px" else math.degrees(2 * math.atan(0.64))
        backend = loaded(DepthPro, contract_graph(second, number))
        own = backend.infer(image, Hints())
        assert own.intrinsics.fx == pytest.approx(100.0)
        known = Intrinsics.from_focal(150.0, 128, 96, "EXIF")
        scaled = backend.infer(image, Hints(intrinsics=known))
        np.testing.assert_allclose(scaled.depth, 1.5 * own.depth, rtol=1e-5)
        assert scaled.intrinsics == known
        assert scaled.notes == ("DepthPro took the focal length for 100 px; its depth is scaled to 150 px",)
        assert own.notes == ("focal length 100 px from DepthPro",)

    def test_the_networks_camera_replaces_a_default_one(self, contract_graph, loaded):
        guess = Intrinsics.from_focal(300.0, 128, 96, "0.95 x the long side", CameraTrust.GUESSED)
        assert (
            loaded(DepthPro, contract_graph()).infer(ramp(96, 128), Hints(intrinsics=guess)).intrinsics.source
            == "DepthPro"
        )

    def test_known_camera_may_be_of_another_size(self, contract_graph, loaded):
        backend = loaded(DepthPro, contract_graph())
        small, large = (Intrinsics.from_focal(f, w, h) for f, w, h in ((150.0, 128, 96), (300.0, 256, 192)))
        first, second = (backend.infer(ramp(96, 128), Hints(intrinsics=camera)).depth for camera in (small, large))
        np.testing.assert_allclose(first, second)

    def test_sky_is_not_known(self, bound):
        """Trap: both forms clip inverse depth at 1e-4, so that the sky lies at 10 km."""
        depth = np.full((1, SIDE, SIDE), 5.0)
        depth[:, : SIDE // 2] = 1e4
        outputs = {"predicted_depth": DEPTH_OUT, "focallength_px": ("float32", (1, 1))}
        answer = {"predicted_depth": depth, "focallength_px": [[1500.0]]}
        backend = bound(DepthPro, PICTURE_IN, outputs, lambda shown, fed: answer)
        answer = backend.infer(ramp(96, 128), Hints())
        assert np.isnan(answer.depth[:46]).all()
        np.testing.assert_allclose(answer.depth[50:], 5.0, rtol=1e-5)

    @pytest.mark.parametrize(
        ("second", "number", "words"),
        [
            ("focallength_px", 0.0, "focallength_px = 0: a number above 0 was expected"),
            ("field_of_view", 200.0, "a field of view of 200 degrees: less than 180 was expected"),
        ],
    )
    def test_impossible_camera_is_refused(self, contract_graph, second, number, words, loaded):
        with pytest.raises(BackendError, match=words):
            loaded(DepthPro, contract_graph(second, number)).infer(ramp(96, 128), Hints())

    def test_file_without_a_focal_length_is_refused(self, graph, node, tmp_path, loaded):
        """Trap: without the second output nobody could tell depth from inverse depth."""
        path = graph(
            tmp_path / "old.onnx",
            PICTURE_IN,
            {"predicted_depth": DEPTH_OUT},
            [node("ReduceMax", ["pixel_values"], ["predicted_depth"], axes=[1], keepdims=0)],
        )
        with pytest.raises(BackendError) as refusal:
            loaded(DepthPro, str(path))
        assert str(refusal.value) == (
            "old.onnx is not a network that this backend can run:\n"
            "expected of metres and focal length in px:\n"
            "  inputs:  pixel_values (or image, input) float (?, 3, 1536, 1536)\n"
            "  outputs: predicted_depth (or depth) float any shape; focallength_px float any shape\n"
            "  but there is no output 'focallength_px'\n"
            "expected of canonical inverse depth and field of view:\n"
            "  inputs:  pixel_values (or image, input) float (?, 3, 1536, 1536)\n"
            "  outputs: predicted_depth float any shape; field_of_view (or fov, fov_deg) float any shape\n"
            "  but there is no output 'field_of_view'\n"
            "found:\n"
            "  inputs:  pixel_values float32 (batch_size, 3, 1536, 1536)\n"
            "  outputs: predicted_depth float32 (batch_size, 1536, 1536)"
        )

    def test_missing_weights_are_listed_before_load(self, monkeypatch, tmp_path):
        monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path))
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        monkeypatch.setenv("HF_HOME", str(tmp_path))
        backend = DepthPro()
        assert backend.missing() == (
            "weights 'depth-pro-fp16' (Apple AMLR: research only) are missing: "
            "`physic weights fetch depth-pro-fp16 --accept-licence` (no commercial use)",
        )
        assert backend.fingerprint() == ""
        with pytest.raises(WeightsMissingError, match="depth-pro-fp16"):
            backend.load()


class TestPreparing:
    @pytest.mark.parametrize("size", [(240, 320), (1600, 1200), (97, 131)])
    def test_photo_is_squashed_as_torch_does_it_without_antialiasing(self, size):
        """Trap: normalised, then bilinear without antialiasing, and not rounded to 8 bits between."""
        torch = pytest.importorskip("torch")
        image = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
        normalised = torch.from_numpy(image.transpose(2, 0, 1)[None].astype(np.float64)) / 255
        wanted = torch.nn.functional.interpolate(
            (normalised - 0.5) / 0.5, size=(SIDE, SIDE), mode="bilinear", align_corners=False, antialias=False
        )
        fed = preprocess(image)
        assert fed.shape == (1, 3, SIDE, SIDE)
        assert fed.dtype == np.float32
        np.testing.assert_allclose(fed, wanted.numpy(), atol=1e-6)


def perfect(shown, feed):
    """Truth, for a focal length that it takes 20 % too short."""
    expect_picture(shown.photo, (feed["pixel_values"][0] + 1) * 127.5, 1.5)
    focal = 0.8 * shown.camera.fx
    inverse = at(1 / shown.depth, SIDE, SIDE)
    return focal, 0.8 / np.clip(inverse, 1e-4, 1e4)


def answer_metres(shown, feed):
    focal, depth = perfect(shown, feed)
    return {"predicted_depth": depth[None], "focallength_px": [[focal * SIDE / shown.photo.shape[1]]]}


def answer_inverse(shown, feed):
    focal, depth = perfect(shown, feed)
    width = shown.photo.shape[1]
    angle = 2 * math.degrees(math.atan(width / (2 * focal)))
    return {"predicted_depth": (focal / (width * depth))[None], "field_of_view": [angle]}


@pytest.mark.parametrize("form", ["metres", "inverse"])
def test_conformance(form, accuracy_of):
    second = {"metres": {"focallength_px": ("float32", (1, 1))}, "inverse": {"field_of_view": ("float32", (1,))}}[form]
    answer = {"metres": answer_metres, "inverse": answer_inverse}[form]
    assert accuracy_of(DepthPro, PICTURE_IN, {"predicted_depth": DEPTH_OUT, **second}, answer)["abs-rel"] < 0.003
