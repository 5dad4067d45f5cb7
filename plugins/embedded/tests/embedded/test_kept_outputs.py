"""Outputs of packaged networks in the cache: a call with the same picture and other settings does
not run them.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.cache.results import ResultCache, network_results_in
from physic_embedded.networks.depth_anything import predict_disparity
from physic_embedded.networks.line_segments import detect_line_segments
from physic_embedded.networks.mobile_sam import embed_image
from physic_embedded.networks.sessions import open_packaged_session

IMAGE = np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8)
NETWORKS = {
    "depth_anything_v2_vits_int8": lambda session: predict_disparity(session, IMAGE, short_side=70),
    "mlsd_large_512": lambda session: detect_line_segments(session, IMAGE),
    "mobilesam_encoder": lambda session: embed_image(session, IMAGE).features,
}


@pytest.mark.parametrize("name", NETWORKS)
def test_a_network_runs_once_for_a_picture(name, tmp_path, monkeypatch):
    session = open_packaged_session(name, threads=1)
    predict = NETWORKS[name]
    expected = predict(session)
    with network_results_in(ResultCache(tmp_path, 10**8)):
        np.testing.assert_array_equal(predict(session), expected)
        monkeypatch.setattr(session, "session", None)  # a second run would need it
        np.testing.assert_array_equal(predict(session), expected)
