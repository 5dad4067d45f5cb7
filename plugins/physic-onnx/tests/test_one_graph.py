"""Finding the one file of an adapter."""

from __future__ import annotations

import pytest

from physic_core.errors import BackendError
from physic_core.weights import read_manifest
from physic_onnx.depth_anything import DepthAnything


@pytest.fixture
def depth_file(graph, node, tmp_path):
    return graph(
        tmp_path / "own" / "mine.onnx",
        {"image": ("float16", (1, 3, 56, 112))},
        {"pred_depth": ("float16", (1, 1, 56, 112))},
        [node("ReduceMax", ["image"], ["pred_depth"], axes=[1], keepdims=1)],
    )


class TestFile:
    def test_default_weights_are_in_the_manifest(self):
        assert DepthAnything.Options().weights in read_manifest(DepthAnything.manifest())

    def test_a_folder_with_one_graph_is_taken_as_that_graph(self, depth_file):
        (depth_file.parent / "notes.txt").write_text("mine")
        for place in (depth_file.parent, depth_file):
            assert DepthAnything(weights=str(place)).graph_file() == depth_file

    @pytest.mark.parametrize("count", [0, 2])
    def test_a_folder_without_exactly_one_graph_is_refused(self, tmp_path, count):
        for i in range(count):
            (tmp_path / f"{i}.onnx").write_bytes(b"0")
        held = "0.onnx, 1.onnx" if count else "none"
        with pytest.raises(BackendError, match=f"holds {held}: give the path of the file itself"):
            DepthAnything(weights=str(tmp_path)).graph_file()
