from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_embedded.networks.line_segments import segments_outside_mask
from physic_embedded.single_view.focal import ManhattanFrame, manhattan_frame
from physic_embedded.single_view.gravity import gravity_from_segments

WIDTH, HEIGHT = 800, 600


def project(points: np.ndarray, focal: float) -> np.ndarray:
    return points[..., :2] / points[..., 2:] * focal + [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]


def edges_of_a_room(focal: float, turn: np.ndarray, *, count: int, noise: float, clutter: int, seed: int) -> np.ndarray:
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
        if (seen >= 0).all() and (seen < [WIDTH, HEIGHT]).all() and np.linalg.norm(seen[1] - seen[0]) > 15:
            segments.append(seen + rng.normal(0, noise, (2, 2)))
    for _ in range(clutter):
        middle, angle = rng.uniform([50, 50], [WIDTH - 50, HEIGHT - 50]), rng.uniform(0, np.pi)
        half = rng.uniform(10, 40) * np.array([np.cos(angle), np.sin(angle)])
        segments.append(np.stack([middle - half, middle + half]))
    return np.array(segments)


def frame_of(segments: np.ndarray) -> ManhattanFrame | None:
    """Estimate the frame with a default of .85 long sides."""
    return manhattan_frame(segments, WIDTH, HEIGHT, 0.85 * WIDTH, 0.25)


@pytest.mark.parametrize(("focal", "seed"), [(480.0, 1), (700.0, 2), (1100.0, 3)])
def test_focal_length_comes_back_from_edges_of_a_room(focal: float, seed: int) -> None:
    turn = Rotation.from_euler("yxz", [35, 12, 4], degrees=True).as_matrix()
    segments = edges_of_a_room(focal, turn, count=90, noise=0.5, clutter=30, seed=seed)
    frame = frame_of(segments)
    assert frame.focal_px == pytest.approx(focal, rel=0.04)
    assert frame.focal_sigma < 0.1
    cosines = np.abs(frame.axes @ turn).max(1)
    assert np.degrees(np.arccos(cosines.clip(max=1))).max() < 1.0
    assert frame.axes @ frame.axes.T == pytest.approx(np.eye(3), abs=1e-6)


@pytest.mark.parametrize("long_sides", [0.55, 0.8, 1.4, 1.9])
def test_clean_edges_give_the_focal_length_within_its_error(long_sides: float) -> None:
    turn = Rotation.from_euler("xyz", [10.0, 35.0, 1.0], degrees=True).as_matrix()
    frame = frame_of(edges_of_a_room(long_sides * WIDTH, turn, count=90, noise=0.1, clutter=0, seed=1))
    assert abs(np.log(frame.focal_px / (long_sides * WIDTH))) < frame.focal_sigma < 0.1


def test_few_edges_of_a_room_among_clutter_move_the_default_by_their_error() -> None:
    turn = Rotation.from_euler("yxz", [35, 12, 4], degrees=True).as_matrix()
    frame = frame_of(edges_of_a_room(480.0, turn, count=40, noise=1.0, clutter=30, seed=1))
    assert 480 < frame.focal_px < 0.85 * WIDTH
    assert 0.1 < frame.focal_sigma < 0.25


def test_the_mirrored_picture_has_the_mirrored_frame() -> None:
    turn = Rotation.from_euler("yxz", [35, 12, 4], degrees=True).as_matrix()
    segments = edges_of_a_room(560.0, turn, count=60, noise=1.0, clutter=30, seed=2)
    frame, mirrored = frame_of(segments), frame_of((np.array([WIDTH - 1, 0]) - segments) * [1, -1])
    assert mirrored.focal_px == pytest.approx(frame.focal_px, rel=1e-6)
    assert mirrored.focal_sigma == pytest.approx(frame.focal_sigma, rel=1e-6)
    assert np.abs(mirrored.axes * [-1, 1, 1] @ frame.axes.T).max(1) == pytest.approx(np.ones(3), abs=1e-6)


def test_the_order_of_segments_does_not_matter() -> None:
    turn = Rotation.from_euler("yxz", [35, 12, 4], degrees=True).as_matrix()
    segments = edges_of_a_room(560.0, turn, count=60, noise=1.0, clutter=30, seed=2)
    assert frame_of(segments[::-1, ::-1]).focal_px == pytest.approx(frame_of(segments).focal_px, rel=1e-6)


def test_edges_that_are_found_in_pieces_count_once() -> None:
    turn = Rotation.from_euler("yxz", [35, 12, 4], degrees=True).as_matrix()
    segments = edges_of_a_room(560.0, turn, count=60, noise=0.5, clutter=10, seed=2)
    once, twice = frame_of(segments), frame_of(np.concatenate([segments, segments]))
    assert twice.focal_px == pytest.approx(once.focal_px, rel=1e-6)
    assert twice.focal_sigma == pytest.approx(once.focal_sigma, rel=1e-6)


def test_segments_of_any_direction_give_no_frame() -> None:
    assert frame_of(edges_of_a_room(600.0, np.eye(3), count=0, noise=0, clutter=80, seed=4)) is None


def test_too_few_segments_give_no_frame() -> None:
    clutter = edges_of_a_room(600.0, np.eye(3), count=0, noise=0, clutter=5, seed=4)
    assert frame_of(clutter) is None
    assert frame_of(np.zeros((0, 2, 2))) is None


@pytest.mark.parametrize("pitch", [-8.0, 0.0, 14.0])
def test_upright_edges_give_gravity(pitch: float) -> None:
    turn = Rotation.from_euler("xz", [pitch, 3.0], degrees=True).as_matrix()  # down is the second column
    segments = edges_of_a_room(700.0, turn, count=60, noise=0.4, clutter=20, seed=7)
    gravity = gravity_from_segments(segments, WIDTH, HEIGHT, 700.0)
    down = turn[:, 1]
    assert np.degrees(np.arccos(gravity.down @ down)) < 1.2
    assert gravity.pitch_deg == pytest.approx(np.degrees(np.arctan2(down[2], down[1])), abs=1.2)
    assert 1.5 <= gravity.sigma_deg < 3


def test_a_default_focal_length_makes_a_steep_pitch_less_sure() -> None:
    turn = Rotation.from_euler("x", 15.0, degrees=True).as_matrix()
    segments = edges_of_a_room(700.0, turn, count=60, noise=0.2, clutter=0, seed=8)
    known = gravity_from_segments(segments, WIDTH, HEIGHT, 700.0)
    default = gravity_from_segments(segments, WIDTH, HEIGHT, 700.0, focal_sigma=0.25)
    assert default.sigma_deg > known.sigma_deg + 2


def test_segments_in_the_made_up_part_are_left_out() -> None:
    hole = np.zeros((100, 100), bool)
    hole[:, 50:] = True
    segments = np.array([[[5, 10], [40, 10]], [[55, 10], [95, 10]], [[40, 20], [52, 20]]], float)
    assert segments_outside_mask(segments, hole).tolist() == [segments[0].tolist(), segments[2].tolist()]
