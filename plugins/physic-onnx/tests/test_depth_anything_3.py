"""Depth Anything 3 metric against graphs of its exports."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import Hints, Intrinsics
from physic_onnx.depth_anything_3 import DepthAnything3, preprocess

from .depth_maps_of_worlds import ramp

IMAGENET_MEAN = np.array([0.485, 0.456, 0.406])
IMAGENET_STD = np.array([0.229, 0.224, 0.225])
FORMS = {
    "504 x 504": (("batch", 3, 504, 504), ("batch", 1, 504, 504)),
    "504 x 280": ((1, 3, 280, 504), (1, 1, 280, 504)),
    "views": ((1, "N", 3, 504, 504), (1, "N", 504, 504)),
    "free": (("b", 3, "h", "w"), ("b", "h", "w")),
}


@pytest.fixture
def contract_graph(graph, node, tmp_path):
    """A network whose depth is red plus 4, and whose sky is blue."""

    def build(form="free", name="model.onnx"):
        shape, map_shape = FORMS[form]
        nodes = [
            node("Gather", ["image", "red"], ["plane"], axis=len(shape) - 3),
            node("Gather", ["image", "blue"], ["score"], axis=len(shape) - 3),
        ]
        spare = len(map_shape) - (len(shape) - 1)
        if spare:
            nodes += [
                node("Unsqueeze", ["plane", "one"], ["map"]),
                node("Unsqueeze", ["score", "one"], ["sky"]),
            ]
        else:
            nodes += [node("Identity", ["plane"], ["map"]), node("Identity", ["score"], ["sky"])]
        nodes.append(node("Add", ["map", "four"], ["depth"]))
        constants = {
            "red": np.array(0, np.int64),
            "blue": np.array(2, np.int64),
            "one": np.array([1], np.int64),
            "four": np.float32(4),
        }
        outputs = {"depth": ("float32", map_shape), "sky": ("float32", map_shape)}
        return str(graph(tmp_path / name, {"image": ("float32", shape)}, outputs, nodes, constants))

    return build


def raw_depth(image):
    return (image[..., 0] / 255 - IMAGENET_MEAN[0]) / IMAGENET_STD[0] + 4


def hints(focal, width, height):
    return Hints(intrinsics=Intrinsics.from_focal(focal, width, height))


class TestContract:
    @pytest.mark.parametrize("form", FORMS)
    def test_metres_are_depth_times_the_seen_focal_length_over_300(
        self, contract_graph, form, loaded
    ):
        """Trap: the focal length of the picture that the network sees, the mean of both axes, and
        not the photo's.
        """
        image = ramp(252, 252, 0)
        answer = loaded(DepthAnything3, contract_graph(form)).infer(image, hints(210.0, 252, 252))
        rows, columns = FORMS[form][0][-2:] if form != "free" else (504, 504)
        focal = 210.0 * (rows / 252 + columns / 252) / 2
        np.testing.assert_allclose(answer.depth, raw_depth(image) * focal / 300, rtol=0.02)
        assert answer.intrinsics.fx == 210.0

    def test_sky_is_where_the_score_is_high_and_has_no_depth(self, contract_graph, loaded):
        """Trap: from 0.3 on it is sky, though a reader of these files holds the opposite."""
        image = ramp(252, 252, 0)
        # Blue in ImageNet's normalisation: 0.29 and 0.31.
        low, high = ((s * IMAGENET_STD[2] + IMAGENET_MEAN[2]) * 255 for s in (0.25, 0.35))
        image[:120, :, 2] = round(high)
        image[120:, :, 2] = round(low)
        depth = loaded(DepthAnything3, contract_graph()).infer(image, hints(210.0, 252, 252)).depth
        assert np.isnan(depth[:118]).all()
        assert np.isfinite(depth[122:]).all()

    def test_far_away_is_not_known(self, contract_graph, loaded):
        image = ramp(252, 252, 0)
        depth = (
            loaded(DepthAnything3, contract_graph(), farthest=6.0)
            .infer(image, hints(210.0, 252, 252))
            .depth
        )
        assert np.isfinite(depth).any()
        assert np.nanmax(depth) <= 6.0
        assert np.isnan(depth[:, -20:]).all()

    def test_it_needs_a_focal_length(self, contract_graph, loaded):
        with pytest.raises(BackendError, match="only for a known focal length"):
            loaded(DepthAnything3, contract_graph()).infer(ramp(252, 252, 0), Hints())

    def test_a_note_says_that_the_photo_was_squashed(self, contract_graph, loaded):
        answer = loaded(DepthAnything3, contract_graph("504 x 280")).infer(
            ramp(640, 480, 0), hints(500.0, 480, 640)
        )
        assert "factor 2.4" in answer.notes[0]

    def test_file_without_a_sky_is_refused(self, graph, node, tmp_path, loaded):
        """Trap: the relative files have the same names, and no sky."""
        path = graph(
            tmp_path / "da3-base.onnx",
            {"image": ("float32", ("b", 3, 504, 504))},
            {"depth": ("float32", ("b", 504, 504))},
            [node("ReduceMax", ["image"], ["depth"], axes=[1], keepdims=0)],
        )
        with pytest.raises(BackendError, match="there is no output 'sky'"):
            loaded(DepthAnything3, str(path))

    def test_relative_file_with_a_sky_is_refused_by_its_name(self, contract_graph, loaded):
        with pytest.raises(BackendError, match="use it as relative_pointmap"):
            loaded(DepthAnything3, contract_graph(name="da3mono_l_504x378.onnx"))


@pytest.mark.parametrize(("size", "how"), [((1000, 800), "area"), ((200, 160), "bicubic")])
def test_photo_is_shrunk_by_areas_and_enlarged_bicubically(size, how):
    import cv2

    image = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    resized = cv2.resize(
        image, (406, 504), interpolation={"area": cv2.INTER_AREA, "bicubic": cv2.INTER_CUBIC}[how]
    )
    wanted = ((resized / 255 - IMAGENET_MEAN) / IMAGENET_STD).transpose(2, 0, 1)[None]
    np.testing.assert_allclose(preprocess(image, 504, 406), wanted, atol=1e-5)
