"""Holding files against what an adapter expects."""

from __future__ import annotations

import pytest

from physic_core.errors import BackendError
from physic_onnx.depth_anything import DepthAnything
from physic_onnx.one_graph import GraphSignature, PortSpec, match_signature

IMAGE = {"image": ("float32", ("batch", 3, "height", "width"))}
WANTED_IMAGE = PortSpec("image", shape=("batch", 3, "height", "width"))


def match(network, inputs, outputs, *, by_position=False):
    """Match a network with one signature."""
    form = GraphSignature(tuple(inputs), tuple(outputs), by_position)
    return match_signature(network, {"one": form})


@pytest.fixture
def file(stand_in_network):
    return lambda inputs, outputs: stand_in_network(inputs, {}, outputs)


def depth(name="depth"):
    return {name: ("float32", ("batch", "height", "width"))}


class TestOneSignature:
    def test_ports_match_by_position_only_where_allowed(self, file):
        network = file(IMAGE, depth(name="out_0"))
        wanted = [PortSpec("depth", shape=(None, None, None))]
        assert (
            match(network, [WANTED_IMAGE], wanted, by_position=True).outputs["depth"].name
            == "out_0"
        )
        with pytest.raises(BackendError, match="there is no output 'depth'"):
            match(network, [WANTED_IMAGE], wanted)

    def test_a_port_is_found_by_its_name_before_its_aliases(self, file):
        network = file(IMAGE, {**depth("z"), **depth()})
        found = match(network, [WANTED_IMAGE], [PortSpec("depth", ("z",))])
        assert found.outputs["depth"].name == "depth"

    def test_an_input_without_a_spec_is_refused(self, file):
        network = file({**IMAGE, "camera": ("float32", (3, 3))}, depth())
        with pytest.raises(BackendError, match="nothing is known of its input 'camera'"):
            match(network, [WANTED_IMAGE], [PortSpec("depth")])

    @pytest.mark.parametrize(
        ("wanted", "dtype", "shape", "fits"),
        [
            (PortSpec("x"), "float16", ("a", "b"), True),
            (PortSpec("x"), "int64", ("a", "b"), False),
            (PortSpec("x", dtype="float32"), "float16", ("a",), False),
            (PortSpec("x", dtype=("int32", "int64")), "int32", ("a",), True),
            (PortSpec("x", shape=(1, 3, None)), "float32", (1, 3, 640), True),
            (PortSpec("x", shape=(1, 3, None)), "float32", ("batch", "?", "n"), True),
            (PortSpec("x", shape=(1, 3, None)), "float32", (1, 4, 640), False),
            (PortSpec("x", shape=(1, 3, None)), "float32", (1, 3), False),
            (PortSpec("x", shape=()), "float32", (1,), False),
            (PortSpec("x", shape=("n",)), "float32", (), False),
        ],
    )
    def test_a_port_of_another_type_or_shape_is_refused(self, file, wanted, dtype, shape, fits):
        network = file({"x": (dtype, shape)}, depth())
        if fits:
            assert match(network, [wanted], []).inputs["x"].shape == shape
        else:
            with pytest.raises(BackendError, match="has another form"):
                match(network, [wanted], [])


class TestFile:
    def test_a_folder_with_one_graph_is_taken_as_that_graph(self, tmp_path):
        (tmp_path / "notes.txt").write_text("mine")
        own = tmp_path / "mine.onnx"
        own.write_bytes(b"0")
        for place in (tmp_path, own):
            assert DepthAnything(weights=str(place)).graph_file() == own

    @pytest.mark.parametrize("count", [0, 2])
    def test_a_folder_without_exactly_one_graph_is_refused(self, tmp_path, count):
        for i in range(count):
            (tmp_path / f"{i}.onnx").write_bytes(b"0")
        held = "0.onnx, 1.onnx" if count else "none"
        with pytest.raises(BackendError, match=f"holds {held}: give the path of the file itself"):
            DepthAnything(weights=str(tmp_path)).graph_file()
