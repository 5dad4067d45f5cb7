"""Products in int8: no overflow on any CPU, and an answer near that of float32."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from onnx import numpy_helper

from physic_embedded.networks.depth_anything import predict_disparity
from physic_embedded.networks.sessions import WEIGHTS_FOLDER, open_packaged_session
from physic_embedded.segmenter import EmbeddedSegmenter

pytestmark = pytest.mark.slow

PHOTO = Path(__file__).parents[4] / "examples" / "couple.jpg"
NETWORK = "depth_anything_v2_vits_int8"
INT16 = np.iinfo(np.int16)


@pytest.fixture(scope="module")
def image():
    return np.ascontiguousarray(cv2.imread(str(PHOTO))[..., ::-1])


def int8_matrices(network):
    model = onnx.load(WEIGHTS_FOLDER / f"{network}.onnx")
    weights = {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    products = [node for node in model.graph.node if node.op_type == "DynamicQuantizeMatMul"]
    return {node.input[1]: weights[node.input[1]] for node in products}


@pytest.mark.parametrize(
    "network", sorted(path.stem for path in WEIGHTS_FOLDER.glob("*_int8.onnx"))
)
def test_no_two_neighbours_overflow_16_bits_whatever_the_activations_are(network):
    """A CPU without VNNI adds pairs of products in 16 bits, with saturation."""
    matrices = int8_matrices(network)
    assert len(matrices) >= 40
    for name, matrix in matrices.items():
        assert matrix.dtype == np.int8, name
        groups = np.sort(matrix.astype(int).reshape(-1, 4, matrix.shape[1]), axis=1)
        largest = 255 * np.maximum(groups[:, 2:], 0).sum(axis=1).max()
        smallest = 255 * np.minimum(groups[:, :2], 0).sum(axis=1).min()
        assert INT16.min <= smallest <= largest <= INT16.max, name


def test_masks_in_int8_are_near_those_in_float32(image):
    small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    masks = []
    for how in ("float32", "int8"):
        segmenter = EmbeddedSegmenter(EmbeddedSegmenter.Options(products=how, threads=1))
        segmenter.load()
        masks.append(segmenter.infer(small).masks)
    assert len(masks[0]) == 2
    for one, other in zip(*masks, strict=True):
        overlap = (one & other).sum() / (one | other).sum()
        assert overlap > 0.97


def test_disparities_in_int8_are_near_those_in_float32(image):
    exact, rounded = (
        predict_disparity(open_packaged_session(name, 1), image, short_side=252)
        for name in ("depth_anything_v2_vits", NETWORK)
    )
    low, high = np.percentile(exact, [2, 98])
    error = np.abs(rounded - exact) / (high - low)
    assert error.mean() < 0.02
    assert np.percentile(error, 99) < 0.05
