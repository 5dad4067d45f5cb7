"""Tokens of the depth network's encoder: where they are read, and that one pass serves two
backends.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.cache.results import ResultCache, network_results_in
from physic_embedded.networks.depth_anything import TOKENS, patch_tokens, predict_disparity
from physic_embedded.networks.patch_tokens import PatchTokens, TokensOfPasses
from physic_embedded.networks.sessions import open_packaged_session
from physic_networks.pictures import Letterbox

GRAPH = "depth_anything_v2_vits_int8"
IMAGE = np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8)
OTHER = IMAGE[:, ::-1].copy()


@pytest.fixture
def grid():
    """4 x 6 patches of 10 px, numbered by row and column; a photo of 120 x 60 px fills the middle
    two rows.
    """
    numbers = np.stack(np.meshgrid(np.arange(4.0), np.arange(6.0), indexing="ij"), axis=-1)
    return PatchTokens(numbers, 10, Letterbox(0.5, 0, 10, (20, 60), (40, 120)))


@pytest.mark.parametrize(
    ("point", "reach", "expected"),
    [
        ((70, 10), 0, (1, 3)),
        ((70, 10), 1, (1.5, 3)),
        ((70, 30), 1, (1.5, 3)),
        ((0, 0), 1, (1.5, 0.5)),
        ((-50, 500), 0, (2, 0)),
    ],
)
def test_a_square_around_a_point_stays_on_the_photo(grid, point, reach, expected):
    [mean] = grid.around(np.array([point]), reach)
    np.testing.assert_allclose(mean, expected)


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        ((20, 0, 60, 20), (1, 1.5)),
        ((0, 0, 120, 40), (1.5, 2.5)),
        ((41, 21, 42, 22), (2, 2)),
        ((-100, -100, 500, 500), (1.5, 2.5)),
    ],
)
def test_a_box_takes_every_patch_that_it_touches(grid, box, expected):
    [mean] = grid.within(np.array([box], float))
    np.testing.assert_allclose(mean, expected)


def test_nobody_has_no_tokens(grid):
    assert grid.around(np.zeros((0, 2))).shape == grid.within(np.zeros((0, 4))).shape == (0, 2)


@pytest.fixture(scope="module")
def session():
    return open_packaged_session(GRAPH, threads=1)


def fail_to_open(graph):
    raise AssertionError(f"{graph} was opened")


def tokens_of(image, opener):
    return patch_tokens(GRAPH, opener, image, 70, 3600).grid


class Reader:
    """Somebody who takes tokens."""


def test_the_tokens_of_the_pass_for_depth_are_read_once(session):
    reader = Reader()
    TOKENS.readers.add(reader)
    without = predict_disparity(session, IMAGE, short_side=70)
    depth = predict_disparity(session, IMAGE, short_side=70, keep_tokens=True)
    np.testing.assert_array_equal(depth, without)
    with pytest.raises(AssertionError, match="was opened"):
        tokens_of(OTHER, fail_to_open)
    shared = tokens_of(IMAGE, fail_to_open)
    with pytest.raises(AssertionError, match="was opened"):
        tokens_of(IMAGE, fail_to_open)
    np.testing.assert_array_equal(shared, tokens_of(IMAGE, lambda _: session))
    assert shared.shape == (5, 7, 384)


def test_a_depth_from_the_cache_leaves_no_tokens(session, tmp_path):
    reader = Reader()
    TOKENS.readers.add(reader)
    with network_results_in(ResultCache(tmp_path, 10**8)):
        for _ in range(2):
            depth = predict_disparity(session, IMAGE, short_side=70, keep_tokens=True)
            first = tokens_of(IMAGE, lambda _: session)
        with pytest.raises(AssertionError, match="was opened"):
            tokens_of(IMAGE, fail_to_open)
    assert np.isfinite(depth).all()
    assert np.isfinite(first).all()


def test_each_reader_has_the_tokens_of_one_pass():
    kept = TokensOfPasses()
    one = Reader()
    kept.put("photo", np.zeros(1))
    assert kept.take("photo") is None
    kept.readers.add(one)
    kept.put("photo", np.zeros(1))
    kept.put("next", np.ones(1))
    assert kept.take("photo") is None
    np.testing.assert_array_equal(kept.take("next"), [1])
    assert kept.take("next") is None
