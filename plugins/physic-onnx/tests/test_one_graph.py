"""Finding, opening and closing the one file of an adapter, and what a map of depth must be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physic_core.errors import BackendError, WeightsMissingError
from physic_core.weights import read_manifest
from physic_onnx.depth_anything import DepthAnythingMetric, DepthAnythingRelative
from physic_onnx.depth_anything_3 import DepthAnything3
from physic_onnx.depth_maps import fixed_input_size, mask_depth, squeeze_map

ADAPTERS = (DepthAnythingMetric, DepthAnythingRelative, DepthAnything3)


@pytest.fixture
def depth_file(graph, node, tmp_path) -> Path:
    return graph(
        tmp_path / "own" / "mine.onnx",
        {"image": ("float16", (1, 3, 56, 112))},
        {"pred_depth": ("float16", (1, 1, 56, 112))},
        [node("ReduceMax", ["image"], ["pred_depth"], axes=[1], keepdims=1)],
    )


class TestFile:
    @pytest.mark.parametrize("adapter", ADAPTERS)
    def test_default_weights_are_in_the_manifest(self, adapter):
        assert adapter.Options().weights in read_manifest(adapter.manifest())

    def test_a_folder_with_one_graph_is_taken_as_that_graph(self, depth_file):
        (depth_file.parent / "notes.txt").write_text("mine")
        for place in (depth_file.parent, depth_file):
            assert DepthAnything3(weights=str(place)).graph_file() == depth_file

    @pytest.mark.parametrize("count", [0, 2])
    def test_a_folder_without_exactly_one_graph_is_refused(self, tmp_path, count):
        for i in range(count):
            (tmp_path / f"{i}.onnx").write_bytes(b"0")
        held = "0.onnx, 1.onnx" if count else "none"
        with pytest.raises(BackendError, match=f"holds {held}: give the path of the file itself"):
            DepthAnything3(weights=str(tmp_path)).graph_file()

    def test_an_unknown_name_gets_a_known_one_suggested(self):
        with pytest.raises(WeightsMissingError, match="Did you mean 'depth-anything-v2-large'"):
            DepthAnything3(weights="depth-anything-v2-larg").graph_file()

    def test_fingerprint_is_of_the_file(self, depth_file):
        first = DepthAnythingMetric(DepthAnythingMetric.Options(weights=str(depth_file))).fingerprint()
        depth_file.write_bytes(depth_file.read_bytes() + b"\n")
        assert first != DepthAnythingMetric(DepthAnythingMetric.Options(weights=str(depth_file))).fingerprint() != ""


class TestMaps:
    @pytest.mark.parametrize("shape", [(2, 3), (1, 2, 3), (1, 1, 2, 3), (1, 2, 3, 1), (1, 1, 1, 2, 3)])
    def test_spare_axes_are_dropped(self, shape):
        values = np.arange(6.0).reshape(shape)
        np.testing.assert_array_equal(squeeze_map(values, "depth", "file"), np.arange(6.0).reshape(2, 3))

    @pytest.mark.parametrize(
        ("values", "words"),
        [
            (np.zeros((2, 3, 4)), r"depth of shape \(2, 3, 4\): one map"),
            (np.full((2, 3), np.nan), "without one finite number"),
            (np.full((2, 3), 0.9741), r"depth = 0\.9741 for every pixel"),
        ],
    )
    def test_a_constant_map_is_refused(self, values, words):
        with pytest.raises(BackendError, match=words):
            squeeze_map(values, "depth", "file")

    def test_flat_map_may_be_an_answer(self):
        assert squeeze_map(np.zeros((1, 2, 3)), "sky", "file", may_be_flat=True).shape == (2, 3)

    def test_depth_that_is_not_known_is_nan(self):
        with np.errstate(invalid="raise"):
            found = mask_depth(np.array([[1.0, 0.0, -2.0], [np.nan, np.inf, 9.0]], np.float32), 5.0)
        np.testing.assert_array_equal(found, np.array([[1, np.nan, np.nan], [np.nan, np.nan, np.nan]], np.float32))
        with pytest.raises(BackendError, match="nothing in this photo nearer than 5 m"):
            mask_depth(np.array([[9.0]], np.float32), 5.0)

    def test_fixed_and_free_sides(self):
        assert fixed_input_size((1, 3, 518, 518)) == (518, 518)
        assert fixed_input_size(("b", 3, "h", 504)) == (None, 504)
