"""Metric3D v2 against graphs of its exports, and against a network that knows the world."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import Hints, Intrinsics
from physic_onnx.metric3d import PADDING, Metric3d, Metric3dOptions, preprocess

from .depth_maps_of_worlds import at, expect_picture, ramp

ROWS, COLUMNS = 616, 1064
FORMS = {
    "published": ("pixel_values", "predicted_depth", ("batch_size", 3, "height", "width"), ("batch_size", "h", "w")),
    "card": ("pixel_values", "pred_depth", (1, 3, "height", "width"), (1, 1, "h", "w")),
    "own export": ("image", "pred_depth", (1, 3, ROWS, COLUMNS), (1, 1, ROWS, COLUMNS)),
    "no batch": ("image", "pred_depth", (3, ROWS, COLUMNS), (ROWS, COLUMNS)),
}


@pytest.fixture
def contract_graph(graph, node, tmp_path):
    """A network whose depth is a channel of its input over 10; it also answers normals where asked to."""

    def build(form: str = "published", channel: int = 0, normals: bool = False) -> str:
        takes, gives, shape, map_shape = FORMS[form]
        nodes = [node("Gather", [takes, "channel"], ["plane"], axis=len(shape) - 3)]
        if len(map_shape) == 4:
            nodes += [node("Unsqueeze", ["plane", "one"], ["map"]), node("Div", ["map", "ten"], [gives])]
        else:
            nodes += [node("Div", ["plane", "ten"], [gives])]
        outputs = {gives: ("float32", map_shape)}
        if normals:
            nodes += [node("Identity", [takes], ["pred_normal"]), node("Identity", ["plane"], ["normal_confidence"])]
            outputs |= {"pred_normal": ("float32", shape), "normal_confidence": ("float32", map_shape[-3:])}
        constants = {"channel": np.array(channel, np.int64), "one": np.array([1], np.int64), "ten": np.float32(10)}
        path = tmp_path / f"{form}{channel}{normals}.onnx"
        return str(graph(path, {takes: ("float32", shape)}, outputs, nodes, constants))

    return build


def hints(focal: float, width: int, height: int) -> Hints:
    return Hints(intrinsics=Intrinsics.from_focal(focal, width, height))


class TestContract:
    @pytest.mark.parametrize("form", FORMS)
    @pytest.mark.parametrize("channel", [0, 1])
    def test_is_fed_0_to_255_and_answers_for_a_focal_length_of_1000(self, contract_graph, form, channel, loaded):
        """Traps: not normalised; metres are depth * focal of the canvas / 1000; the file's names and its batch vary."""
        image = ramp(308, 532)
        answer = loaded(Metric3d, contract_graph(form, channel)).infer(image, hints(500.0, 532, 308))
        np.testing.assert_allclose(answer.depth, image[..., channel] / 10 * (500 * 2 / 1000), rtol=0.03)
        assert answer.intrinsics.fx == 500.0

    def test_normals_are_left_alone(self, contract_graph, loaded):
        loaded(Metric3d, contract_graph(normals=True)).infer(ramp(308, 532), hints(500.0, 532, 308))

    def test_canvas_of_a_free_file_can_be_chosen(self, bound):
        seen = []
        backend = bound(
            Metric3d,
            {"pixel_values": ("float32", FORMS["published"][2])},
            {"pred_depth": ("float32", FORMS["published"][3])},
            lambda shown, fed: seen.append(fed["pixel_values"].shape) or {"pred_depth": fed["pixel_values"][:, 0]},
            height=1064,
            width=616,
        )
        backend.infer(ramp(400, 300), hints(500.0, 300, 400))
        assert seen == [(1, 3, 1064, 616)]
        with pytest.raises(ValueError, match="multiple of 28"):
            Metric3dOptions(height=600)

    def test_far_away_is_not_known(self, contract_graph, loaded):
        depth = loaded(Metric3d, contract_graph(), farthest=15.0).infer(ramp(308, 532), hints(500.0, 532, 308)).depth
        assert np.isnan(depth[:, -50:]).all()
        assert np.nanmax(depth) <= 15.0

    def test_without_a_focal_length_it_says_what_to_configure(self, contract_graph, loaded):
        with pytest.raises(BackendError, match=r"only for a known focal length.*set focal_px in \[photo\]"):
            loaded(Metric3d, contract_graph()).infer(ramp(308, 532), Hints())


def test_canvas_is_padded_with_the_mean_round_the_middle():
    image = np.random.default_rng(0).integers(0, 256, (400, 300, 3), dtype=np.uint8)
    fed, box = preprocess(image, ROWS, COLUMNS)
    assert (box.inner, box.top, box.left) == ((616, 462), 0, 301)
    np.testing.assert_allclose(
        fed[0, :, :, :301], np.array(PADDING)[:, None, None] * np.ones((3, ROWS, 301)), rtol=1e-6
    )
    np.testing.assert_allclose(
        fed[0, :, :, 763:], np.array(PADDING)[:, None, None] * np.ones((3, ROWS, 301)), rtol=1e-6
    )
    import cv2

    wanted = cv2.resize(image.astype(np.float32), (462, 616), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(fed[0, :, :, 301:763], wanted.transpose(2, 0, 1), atol=1e-3)
    assert fed.max() > 200


def perfect(shown, fed):
    """Depth of a camera of 1000 px where the photo should lie in the canvas, nonsense round it."""
    (picture,) = fed.values()
    picture = picture.reshape(3, *picture.shape[-2:])
    height, width = shown.photo.shape[:2]
    scale = min(picture.shape[1] / height, picture.shape[2] / width)
    rows, columns = round(height * scale), round(width * scale)
    top, left = (picture.shape[1] - rows) // 2, (picture.shape[2] - columns) // 2
    expect_picture(shown.photo, picture[:, top : top + rows, left : left + columns], 2)
    depth = np.full(picture.shape[1:], 0.1)
    inverse = np.maximum(at(1 / shown.depth, rows, columns), 1 / 250)
    depth[top : top + rows, left : left + columns] = 1 / inverse * 1000 / (shown.camera.fx * scale)
    return depth


@pytest.mark.parametrize("form", FORMS)
def test_conformance(form, accuracy_of):
    takes, gives, shape, map_shape = FORMS[form]

    def answer(shown, fed):
        depth = perfect(shown, fed)
        return {gives: depth.reshape((1,) * (len(map_shape) - 2) + depth.shape)}

    accuracy = accuracy_of(Metric3d, {takes: ("float32", shape)}, {gives: ("float32", map_shape)}, answer)
    assert accuracy["abs-rel"] < 0.003
