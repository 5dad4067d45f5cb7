"""Cameras of worlds are recovered in degrees and metres from matches and poses with errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from physic_cameras.bundle import CalibratedRig, Matches
from physic_cameras.depth_anything_3 import DepthAnything3Cameras
from physic_cameras.lightglue import LightGlueCameras
from physic_cameras.rig import CameraRig, triangulate
from physic_core.errors import BackendError, InputError
from physic_core.types import CameraTrust, MomentView, SolvedCameras
from physic_testing.conformance.cases import build_case
from physic_testing.conformance.moment import build_moment, true_cameras

from .stand_ins import TrueMatcher, TruePoses

MOMENTS = ("one person", "several people")


def by_matches(views: tuple[MomentView, ...], **of_matcher: Any) -> SolvedCameras:
    backend = LightGlueCameras()
    backend._matcher = TrueMatcher(**of_matcher)
    return backend(views)


def by_poses(views: tuple[MomentView, ...], **of_network: Any) -> SolvedCameras:
    backend = DepthAnything3Cameras()
    backend._network = TruePoses([np.asarray(view.image) for view in views if len(view.people)], **of_network)
    return backend(views)


BOTH = pytest.mark.parametrize("solve", [by_matches, by_poses])


def errors(found: SolvedCameras, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Degrees (V,) and, relative to the distance, positions (V,) that a solution is off."""
    rotation, translation = true_cameras(build_case(name), found.reference)
    cosine = (np.einsum("vij,vij->v", found.rotation, rotation) - 1) / 2
    own, true = (
        -np.einsum("vji,vj->vi", R, t) for R, t in ((found.rotation, found.translation), (rotation, translation))
    )
    away = np.linalg.norm(own - true, axis=1) / np.maximum(np.linalg.norm(true, axis=1), 1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))), away


def noisy(view: MomentView, seed: int, focal: float) -> MomentView:
    """A photo whose keypoints are 1 % of a person off, whose bodies are 10 % too near or far, and whose focal length is
    ``focal`` (logarithm) off."""
    rng = np.random.default_rng(seed)
    size = np.ptp(view.people.boxes[:, 1::2], axis=1)[:, None, None]
    points = view.keypoints.points + 0.01 * size * rng.standard_normal(view.keypoints.points.shape)
    parameters = view.bodies.parameters
    factor = np.exp(0.1 * rng.standard_normal((len(size), 1))).astype(np.float32)
    turned = parameters.global_orient + np.float32(0.1) * rng.standard_normal((len(size), 3)).astype(np.float32)
    bodies = replace(
        view.bodies, parameters=replace(parameters, transl=factor * parameters.transl, global_orient=turned)
    )
    camera = view.intrinsics
    wrong = replace(
        camera,
        fx=camera.fx * np.exp(focal),
        fy=camera.fy * np.exp(focal),
        trust=CameraTrust.ESTIMATED,
        focal_sigma=0.15,
    )
    return replace(view, keypoints=replace(view.keypoints, points=points), bodies=bodies, intrinsics=wrong)


@BOTH
@pytest.mark.parametrize("name", MOMENTS)
def test_true_photos_give_true_cameras(solve: Any, name: str) -> None:
    found = solve(build_moment(build_case(name)))
    turned, away = errors(found, name)
    bound = 2.0 if solve is by_matches else 6.0
    assert turned.max() < bound
    assert away.max() < 0.1
    assert not found.skipped
    assert all(len(set(row[row >= 0])) == 1 for row in found.people)


@BOTH
def test_wrong_focal_lengths_are_corrected(solve: Any) -> None:
    name = "several people"
    views = build_moment(build_case(name))
    found = solve(
        tuple(noisy(view, v, focal) for v, (view, focal) in enumerate(zip(views, (0.15, -0.1, 0.1), strict=True)))
    )
    turned, away = errors(found, name)
    assert turned.max() < 3
    assert away.max() < 0.1
    for camera, view in zip(found.intrinsics, views, strict=True):
        assert abs(np.log(camera.fx / view.intrinsics.fx)) < 0.07


def test_half_of_the_matches_can_be_wrong() -> None:
    turned, away = errors(by_matches(build_moment(build_case("several people")), outliers=0.5), "several people")
    assert turned.max() < 3
    assert away.max() < 0.1


@BOTH
def test_errors_are_of_the_size_that_is_stated(solve: Any) -> None:
    name, shares = "several people", []
    views = build_moment(build_case(name))
    for seed in range(4):
        found = solve(tuple(noisy(view, 10 * seed + v, 0.1 * (v - 1)) for v, view in enumerate(views)))
        turned, _ = errors(found, name)
        kept = found.rotation_sigma > 0
        shares.append(turned[kept] / np.degrees(found.rotation_sigma[kept]))
    assert 0.1 < np.sqrt(np.mean(np.concatenate(shares) ** 2)) < 2


@BOTH
def test_known_poses_stay_and_give_the_scale(solve: Any) -> None:
    """Bodies are a fifth too small, and two of three poses known."""
    name = "several people"
    views = build_moment(build_case(name))
    rotation, translation = true_cameras(build_case(name), 0)
    small = [replace(view.bodies.parameters, betas=view.bodies.parameters.betas - 2) for view in views]
    given = []
    for v, view in enumerate(views):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation[v].T, -rotation[v].T @ translation[v]
        bodies = replace(view.bodies, parameters=small[v])
        given.append(replace(view, bodies=bodies, pose=None if v == 1 else pose))
    found = solve(tuple(given))
    turned, away = errors(found, name)
    assert found.reference in (0, 2)
    assert turned[[0, 2]].max() < 1e-4
    assert away[[0, 2]].max() < 1e-6
    assert away[1] < 0.05
    assert found.scale_sigma == 0
    assert [found.intrinsics[v] == views[v].intrinsics for v in range(3)] == [True, False, True]


@BOTH
def test_known_statures_give_the_scale(solve: Any) -> None:
    views = build_moment(build_case("one person"))
    plain = solve(views)
    tall = solve(tuple(replace(view, statures=np.array([2.4])) for view in views))
    lengths = [np.linalg.norm(found.translation, axis=1).max() for found in (plain, tall)]
    assert 1.2 < lengths[1] / lengths[0] < 1.7
    assert tall.scale_sigma < plain.scale_sigma


@BOTH
def test_a_photo_without_people_is_skipped(solve: Any) -> None:
    views = build_moment(build_case("several people"))
    people, keypoints, bodies = views[1].people, views[1].keypoints, views[1].bodies
    parameters = type(bodies.parameters)(**{key: value[:0] for key, value in vars(bodies.parameters).items()})
    empty = replace(
        views[1],
        people=replace(people, masks=people.masks[:0], boxes=people.boxes[:0], scores=people.scores[:0]),
        keypoints=replace(keypoints, points=keypoints.points[:0], confidence=keypoints.confidence[:0]),
        bodies=replace(bodies, parameters=parameters, joints=bodies.joints[:0]),
        statures=views[1].statures[:0],
    )
    found = solve((views[0], empty, views[2]))
    assert [(one.index, one.reason) for one in found.skipped] == [(1, "no people")]


def test_photos_of_two_rooms_are_an_error() -> None:
    views = [build_moment(build_case(name))[0] for name in MOMENTS]
    with pytest.raises(InputError, match=r"no two of the photos .* show the same background"):
        by_matches(tuple(views))


def test_poses_without_a_shared_person_are_an_error() -> None:
    views = build_moment(build_case("several people"))
    with pytest.raises(InputError, match=r"no person of .* is where another of these photos shows one"):
        by_poses(views[:2], turn_deg=60)


def test_pixels_of_people_do_not_match() -> None:
    views = build_moment(build_case("several people"))
    seen = []

    class Everywhere(TrueMatcher):
        def match(self, one: Any, two: Any) -> np.ndarray:
            seen.append((one, two))
            return super().match(one, two)

    backend = LightGlueCameras(margin=0)
    backend._matcher = Everywhere()
    backend(views)
    for (one, two), pair in zip(seen, ((0, 1), (0, 2), (1, 2)), strict=True):
        for features, v in zip((one, two), pair, strict=True):
            columns, rows = features.pixels.round().astype(int).T
            height, width = views[v].image.shape[:2]
            rows, columns = rows.clip(0, height - 1), columns.clip(0, width - 1)
            assert not views[v].people.masks[:, rows, columns].any()


@pytest.mark.parametrize("kind", [LightGlueCameras, DepthAnything3Cameras])
def test_a_solver_without_its_network_says_so(kind: Any) -> None:
    with pytest.raises(BackendError, match=r"is not loaded: call load\(\) before infer\(\)"):
        kind()(build_moment(build_case("one person")))


def test_three_cameras_triangulate_points() -> None:
    rng = np.random.default_rng(0)
    rotation = np.stack([np.linalg.qr(np.eye(3) + 0.2 * rng.standard_normal((3, 3)))[0] for _ in range(3)])
    rotation *= np.linalg.det(rotation)[:, None, None]
    rotation *= np.sign(rotation[:, 2, 2])[:, None, None]
    rotation[:, 0] *= np.linalg.det(rotation)[:, None]
    rig = CameraRig(rotation, np.array([[0.0, 0, 6], [1, 0, 6], [0, 1, 7]]))
    points = rng.uniform(-1, 1, (5, 3))
    local = rig.to_cameras(points)
    weight = np.ones((3, 5))
    weight[0, 3], weight[:2, 4] = 0, 0
    found = triangulate(local[..., :2] / local[..., 2:], weight, rig)
    np.testing.assert_allclose(found[:4], points[:4], atol=1e-9)
    assert np.isnan(found[4]).all()


def test_errors_of_matches_are_pixels_from_the_epipolar_line() -> None:
    """A pure motion along x: lines are horizontal, and a point one unit below its line is 1 / sqrt(2) off."""
    rig = CameraRig(np.stack([np.eye(3)] * 2), np.array([[0.0, 0, 0], [1, 0, 0]]))
    rays = np.array([[[0.1, 0.0], [0.3, 0.0]], [[0.1, 0.0], [0.3, 0.01]]])
    matches = Matches(np.array([[0, 1], [0, 1]]), rays, np.full(2, 0.001))
    found = np.abs(matches.errors(CalibratedRig(rig, np.zeros(2))))
    np.testing.assert_allclose(found, [0, 10 / np.sqrt(2)], atol=1e-9)
