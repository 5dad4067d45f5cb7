from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_embedded.single_view.focal import focal_of_segments, manhattan_frame
from physic_embedded.single_view.gravity import UpInPhoto, up_from_edges

WIDTH = 800
HEIGHT = 600


def project(points, focal):
    return points[..., :2] / points[..., 2:] * focal + [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]


def turned(axes, *degrees):
    """Directions of a room, in columns."""
    return Rotation.from_euler(axes, degrees, degrees=True).as_matrix()


ROOM = turned("yxz", 35, 12, 4)


def edges_of_a_room(focal=560.0, turn=ROOM, *, count=60, noise=1.0, clutter=20, seed=2):
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
    return np.array(segments).reshape(-1, 2, 2)


def mirrored(segments):
    """Return the segments of the mirrored picture."""
    return np.array([WIDTH - 1, 0]) - segments * [1, -1]


def focal_of(segments):
    """Estimate the focal length and its sigma with a default of .85 long sides."""
    return focal_of_segments(segments, WIDTH, HEIGHT, 0.85 * WIDTH, 0.25)


def frame_of(segments):
    return manhattan_frame(segments, WIDTH, HEIGHT, 560.0)


@pytest.mark.parametrize(("focal", "seed"), [(480.0, 1), (700.0, 2), (1100.0, 3)])
def test_focal_length_comes_back_from_edges_of_a_room(focal, seed):
    found, sigma = focal_of(edges_of_a_room(focal, count=90, noise=0.5, clutter=30, seed=seed))
    assert found == pytest.approx(focal, rel=0.04)
    assert sigma < 0.1


@pytest.mark.parametrize("long_sides", [0.55, 0.8, 1.4, 1.9])
def test_clean_edges_give_the_focal_length_within_its_error(long_sides):
    focal = long_sides * WIDTH
    turn = turned("xyz", 10, 35, 1)
    found, sigma = focal_of(edges_of_a_room(focal, turn, count=90, noise=0.1, clutter=0, seed=1))
    assert abs(np.log(found / focal)) < sigma < 0.1


def test_few_edges_of_a_room_among_clutter_move_the_default_by_their_error():
    found, sigma = focal_of(edges_of_a_room(480.0, count=40, clutter=30, seed=1))
    assert 480 < found < 0.85 * WIDTH
    assert 0.1 < sigma < 0.25


def test_neither_mirror_nor_order_nor_pieces_of_an_edge_change_the_focal_length():
    segments = edges_of_a_room()
    found = focal_of(segments)
    assert abs(np.log(found[0] / (0.85 * WIDTH))) > 0.05
    for other in (mirrored(segments), segments[::-1, ::-1], np.concatenate([segments, segments])):
        assert focal_of(other) == pytest.approx(found, rel=1e-6)


@pytest.mark.parametrize("clutter", [80, 5, 0])
def test_edges_of_any_direction_or_too_few_say_nothing(clutter):
    segments = edges_of_a_room(count=0, clutter=clutter, seed=4)
    assert focal_of(segments) is None
    assert frame_of(segments) is None


def test_the_directions_of_a_room_come_back_from_its_edges_and_mirrored():
    segments = edges_of_a_room()
    axes, trust = frame_of(segments)
    assert np.degrees(np.arccos(np.abs(axes @ ROOM).max(1))).max() < 1.5
    other, same = frame_of(mirrored(segments))
    assert np.abs(other * [-1, 1, 1] @ axes.T).max(1) == pytest.approx(1.0)
    assert same == pytest.approx(trust)
    assert 0 < frame_of(edges_of_a_room(clutter=120))[1] < trust < 1


@pytest.mark.parametrize(("open_air", "most"), [(-0.8, 2.5), (0.8, 8.0)])
def test_up_is_the_vertical_of_a_room_and_less_sure_outdoors(open_air, most):
    segments = edges_of_a_room()
    frame = frame_of(segments)
    wanted = ROOM[:, 1]
    look = UpInPhoto(-wanted * np.sign(wanted[1]), 8.0, "look")
    found = up_from_edges(frame, open_air, look)
    assert np.degrees(np.arccos(abs(found.up @ wanted))) < 1.5
    assert found.up[1] < 0 < found.sigma < most
    assert found.sigma > most / 3
    other = up_from_edges(
        frame_of(mirrored(segments)), open_air, look._replace(up=look.up * [-1, 1, 1])
    )
    assert other.up * [-1, 1, 1] == pytest.approx(found.up, abs=1e-6)
