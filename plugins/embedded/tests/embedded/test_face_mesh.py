"""The direction of a face: of two people who look at each other, and of what is none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physic_core.types import Intrinsics, Keypoints, People, skeleton_named
from physic_embedded.networks.crops import ImagePyramid
from physic_embedded.networks.face_mesh import KEYPOINTS, face_square, predict_face_direction
from physic_embedded.networks.sessions import open_packaged_session
from physic_embedded.person_observer import EmbeddedPersonObserver

LEFT_PERSON, RIGHT_PERSON = (
    dict(zip(KEYPOINTS, map(np.array, points), strict=True))
    for points in (
        [(812, 355), (812, 339), (792, 338), (801, 343), (762, 343), (809, 372), (796, 372)],
        [(1038, 372), (1054, 357), (1032, 361), (1081, 361), (1037, 368), (1055, 387), (1039, 390)],
    )
)


@pytest.fixture(scope="module")
def couple(pytestconfig):
    bgr = cv2.imread(str(pytestconfig.rootpath / "examples" / "couple.jpg"))
    return np.ascontiguousarray(bgr[..., ::-1])


@pytest.fixture(scope="module")
def network():
    return open_packaged_session("face_landmark", threads=1)


def mirrored(at, width):
    """Points of the mirrored photo, in which left and right change places."""
    other = {"left": "right", "right": "left"}
    found = {}
    for name, (x, y) in at.items():
        side, _, rest = name.partition("_")
        found[f"{other[side]}_{rest}" if rest else name] = np.array([width - 1 - x, y])
    return found


def test_two_people_look_at_each_other(couple, network):
    picture = ImagePyramid.from_image(couple)
    middle, forward = predict_face_direction(network, picture, face_square(LEFT_PERSON))
    assert np.linalg.norm(middle - LEFT_PERSON["nose"]) < 30
    assert forward[0] > 0.5
    assert predict_face_direction(network, picture, face_square(RIGHT_PERSON))[1][0] < -0.5


def test_a_mirrored_face_looks_to_the_other_side(couple, network):
    picture, other = (ImagePyramid.from_image(image) for image in (couple, couple[:, ::-1].copy()))
    at = mirrored(RIGHT_PERSON, couple.shape[1])
    _, forward = predict_face_direction(network, picture, face_square(RIGHT_PERSON))
    _, back = predict_face_direction(network, other, face_square(at))
    assert np.degrees(np.arccos(forward @ (back * [-1, 1, 1]))) < 10


def test_what_is_no_face_has_no_direction(couple, network):
    elsewhere = {name: point + np.array([500, 0]) for name, point in RIGHT_PERSON.items()}
    picture = ImagePyramid.from_image(couple)
    assert predict_face_direction(network, picture, face_square(elsewhere)) is None


def test_the_observer_turns_the_direction_to_the_ray_of_the_face(couple):
    names = skeleton_named("blazepose33").names
    points = np.zeros((1, len(names), 2), np.float32)
    for name, point in LEFT_PERSON.items():
        points[0, names.index(name)] = point
    keypoints = Keypoints(points, np.ones(points.shape[:2], np.float32), "blazepose33")
    height, width = couple.shape[:2]
    box = np.array([[600, 250, 930, 1070]], np.float32)
    people = People(np.ones((1, height, width), bool), box, np.ones(1, np.float32))
    observer = EmbeddedPersonObserver(short_side=154, threads=1)
    observer.load()
    far, near = (
        observer.infer(couple, people, keypoints, Intrinsics(f, f, cx, 640, width, height)).head[0]
        for f, cx in ((1e6, 960.0), (800.0, 1600.0))
    )
    observer.close()
    assert np.linalg.norm([far, near], axis=1) == pytest.approx([1, 1], abs=1e-5)
    turned = np.arctan2(near[0], -near[2]) - np.arctan2(far[0], -far[2])
    assert turned == pytest.approx(np.arctan((1600 - 812) / 800), abs=0.1)
