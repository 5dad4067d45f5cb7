from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_embedded.networks.line_segments import segments_outside_mask
from physic_embedded.single_view.focal import focal_of_segments, manhattan_frame
from physic_embedded.single_view.pitch import pitch_from_segments

WIDTH = 800
HEIGHT = 600


def project(points, focal):
    return points[..., :2] / points[..., 2:] * focal + [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]


def edges_of_a_room(focal, turn, *, count, noise, clutter, seed):
    """Segments along three orthogonal directions, the columns of ``turn``, and random ones."""
    rng = np.random.default_rng(seed)
    segments = []
    while len(segments) < count:
        middle = np.array([*rng.uniform(-2.5, 2.5, 2), rng.uniform(3, 7)])
        along = turn[:, len(segments) % 3] * rng.uniform(0.3, 1.0)
        ends = np.stack([middle - along, middle + along])
        if ends[:, 2].min() < 0.5:
            continue
        seen = project(ends, focal)
        if (
            (seen >= 0).all()
            and (seen < [WIDTH, HEIGHT]).all()
            and np.linalg.norm(seen[1] - seen[0]) > 15
        ):
            segments.append(seen + rng.normal(0, noise, (2, 2)))
    for _ in range(clutter):
        middle = rng.uniform([50, 50], [WIDTH - 50, HEIGHT - 50])
        angle = rng.uniform(0, np.pi)
        half = rng.uniform(10, 40) * np.array([np.cos(angle), np.sin(angle)])
        segments.append(np.stack([middle - half, middle + half]))
    return np.array(segments)


def mirrored(segments):
    """Return the segments of the mirrored picture."""
    return np.array([WIDTH - 1, 0]) - segments * [1, -1]


def focal_of(segments):
    """Estimate the focal length and its sigma with a default of .85 long sides."""
    return focal_of_segments(segments, WIDTH, HEIGHT, 0.85 * WIDTH, 0.25)


@pytest.fixture(scope="module")
def turn():
    """Directions of a room, in columns."""
    return Rotation.from_euler("yxz", [35, 12, 4], degrees=True).as_matrix()


@pytest.mark.parametrize(("focal", "seed"), [(480.0, 1), (700.0, 2), (1100.0, 3)])
def test_focal_length_comes_back_from_edges_of_a_room(turn, focal, seed):
    found, sigma = focal_of(
        edges_of_a_room(focal, turn, count=90, noise=0.5, clutter=30, seed=seed)
    )
    assert found == pytest.approx(focal, rel=0.04)
    assert sigma < 0.1


@pytest.mark.parametrize("long_sides", [0.55, 0.8, 1.4, 1.9])
def test_clean_edges_give_the_focal_length_within_its_error(long_sides):
    turn = Rotation.from_euler("xyz", [10.0, 35.0, 1.0], degrees=True).as_matrix()
    found, sigma = focal_of(
        edges_of_a_room(long_sides * WIDTH, turn, count=90, noise=0.1, clutter=0, seed=1)
    )
    assert abs(np.log(found / (long_sides * WIDTH))) < sigma < 0.1


def test_few_edges_of_a_room_among_clutter_move_the_default_by_their_error(
    turn,
):
    found, sigma = focal_of(edges_of_a_room(480.0, turn, count=40, noise=1.0, clutter=30, seed=1))
    assert 480 < found < 0.85 * WIDTH
    assert 0.1 < sigma < 0.25


def test_neither_mirror_nor_order_nor_pieces_of_an_edge_change_the_focal_length(
    turn,
):
    segments = edges_of_a_room(560.0, turn, count=60, noise=1.0, clutter=20, seed=2)
    found = focal_of(segments)
    assert abs(np.log(found[0] / (0.85 * WIDTH))) > 0.05
    for other in (mirrored(segments), segments[::-1, ::-1], np.concatenate([segments, segments])):
        assert focal_of(other) == pytest.approx(found, rel=1e-6)


def test_segments_of_any_direction_say_nothing():
    assert focal_of(edges_of_a_room(600.0, np.eye(3), count=0, noise=0, clutter=80, seed=4)) is None


def test_too_few_segments_say_nothing():
    clutter = edges_of_a_room(600.0, np.eye(3), count=0, noise=0, clutter=5, seed=4)
    assert focal_of(clutter) is None
    assert focal_of(np.zeros((0, 2, 2))) is None


def test_the_directions_of_a_room_come_back_from_its_edges_and_mirrored(turn):
    segments = edges_of_a_room(560.0, turn, count=60, noise=1.0, clutter=20, seed=2)
    axes, trust = manhattan_frame(segments, WIDTH, HEIGHT, 560.0)
    assert np.degrees(np.arccos(np.abs(axes @ turn).max(1))).max() < 1.5
    other, same = manhattan_frame(mirrored(segments), WIDTH, HEIGHT, 560.0)
    assert np.abs(other * [-1, 1, 1] @ axes.T).max(1) == pytest.approx(1.0)
    assert same == pytest.approx(trust)
    few = edges_of_a_room(560.0, turn, count=60, noise=1.0, clutter=120, seed=2)
    assert 0 < manhattan_frame(few, WIDTH, HEIGHT, 560.0)[1] < trust < 1


def test_edges_of_any_direction_or_too_few_give_no_directions():
    for clutter in (80, 5):
        segments = edges_of_a_room(600.0, np.eye(3), count=0, noise=0, clutter=clutter, seed=4)
        assert manhattan_frame(segments, WIDTH, HEIGHT, 600.0) is None


@pytest.mark.parametrize("pitch", [-8.0, 0.0, 14.0])
def test_upright_edges_give_the_pitch(pitch):
    # down is the second column
    turn = Rotation.from_euler("xz", [pitch, 3.0], degrees=True).as_matrix()
    segments = edges_of_a_room(700.0, turn, count=60, noise=0.4, clutter=20, seed=7)
    found, sigma = pitch_from_segments(segments, WIDTH, HEIGHT, 700.0)
    down = turn[:, 1]
    assert found == pytest.approx(np.degrees(np.arctan2(down[2], down[1])), abs=1.2)
    assert 1.5 <= sigma < 3


def test_the_mirrored_picture_has_the_same_pitch():
    turn = Rotation.from_euler("xz", [8.0, 3.0], degrees=True).as_matrix()
    segments = edges_of_a_room(700.0, turn, count=60, noise=1.0, clutter=40, seed=7)
    own, other = (
        pitch_from_segments(s, WIDTH, HEIGHT, 700.0) for s in (segments, mirrored(segments))
    )
    assert other == pytest.approx(own, abs=1e-6)


def test_a_default_focal_length_makes_a_steep_pitch_less_sure():
    turn = Rotation.from_euler("x", 15.0, degrees=True).as_matrix()
    segments = edges_of_a_room(700.0, turn, count=60, noise=0.2, clutter=0, seed=8)
    _, known = pitch_from_segments(segments, WIDTH, HEIGHT, 700.0)
    _, default = pitch_from_segments(segments, WIDTH, HEIGHT, 700.0, focal_sigma=0.25)
    assert default > known + 2


def test_segments_in_the_made_up_part_are_left_out():
    hole = np.zeros((100, 100), bool)
    hole[:, 50:] = True
    segments = np.array([[[5, 10], [40, 10]], [[55, 10], [95, 10]], [[40, 20], [52, 20]]], float)
    assert segments_outside_mask(segments, hole).tolist() == [
        segments[0].tolist(),
        segments[2].tolist(),
    ]
