"""CameraHMR: its crop, what it is given of box and camera, its camera in the photo's, and the kit on stand-ins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator
from physic_core.types import Bodies, Hints, Intrinsics, Keypoints, People, Skeleton
from physic_onnx.camerahmr import CameraHmr
from physic_testing import violations
from physic_testing.conformance import check_backend

from .pose_worlds import normalised, region, sampled, whose

PORTS = {
    "img": ("float32", ("b", 3, 256, 256)),
    "box_center": ("float32", ("b", 2)),
    "box_size": ("float32", ("b",)),
    "img_size": ("float32", ("b", 2)),
    "cam_int": ("float32", ("b", 3, 3)),
}
ANSWERS = {
    "global_orient": ("float32", ("b", 1, 3, 3)),
    "body_pose": ("float32", ("b", 23, 3, 3)),
    "betas": ("float32", ("b", 10)),
    "pred_cam": ("float32", ("b", 3)),
    "joints": ("float32", ("b", 24, 3)),
}
IMAGE = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
BOXES = np.array([[40.0, 20.0, 120.0, 220.0], [150.0, 60.0, 300.0, 200.0]])
PEOPLE = People(np.zeros((2, 240, 320), bool), BOXES, np.ones(2))
NO_KEYPOINTS = Keypoints(np.zeros((2, 17, 2)), np.zeros((2, 17)), "coco17")
CAMERA = Intrinsics(400.0, 400.0, 140.0, 100.0, 320, 240)


class Recorded:
    """A network that answers resting bodies, and keeps what it was fed."""

    name, provider = "camerahmr.onnx", "CPU"

    def __init__(self, network: Any, weak: tuple[float, float, float] = (0.9, 0.1, -0.2)) -> None:
        self.inputs, self.outputs, self.weak, self.fed = network.inputs, network.outputs, weak, []

    def run(self, feed: Any, outputs: Any) -> list[np.ndarray]:
        self.fed.append(feed)
        n = len(feed["img"])
        answers = {
            "global_orient": np.tile(np.eye(3), (n, 1, 1, 1)),
            "body_pose": np.tile(Rotation.from_rotvec([0.1, 0, 0]).as_matrix(), (n, 23, 1, 1)),
            "betas": np.zeros((n, 10)),
            "pred_cam": np.tile(self.weak, (n, 1)),
            "joints": np.zeros((n, 24, 3)),
        }
        return [answers[name].astype(np.float32) for name in outputs]


@pytest.fixture
def recorded(stand_in_network: Any) -> Any:
    def make(weak: tuple[float, float, float] = (0.9, 0.1, -0.2), **options: Any) -> tuple[CameraHmr, Recorded]:
        backend = CameraHmr(CameraHmr.Options(**options))
        network = Recorded(stand_in_network(PORTS, ANSWERS, lambda *_: {}), weak)
        backend.bind(network)
        return backend, network

    return make


def ask(backend: CameraHmr, camera: Intrinsics = CAMERA) -> Bodies:
    return backend.infer(IMAGE, PEOPLE, camera, NO_KEYPOINTS, Hints())


def square(box: np.ndarray, margin: float = 1.0) -> tuple[np.ndarray, float]:
    """Centre and side of the crop, as the checkout computes them, between pixel centres."""
    return (box[:2] + box[2:]) / 2 - 0.5, float((box[2:] - box[:2]).max() * margin)


@pytest.mark.parametrize("margin", [1.0, 1.2])
def test_it_is_shown_a_square_of_rgb_with_black_outside(recorded: Any, margin: float) -> None:
    backend, network = recorded(margin=margin)
    ask(backend)
    for shown, box in zip(network.fed[0]["img"], BOXES, strict=True):
        centre, side = square(box, margin)
        step = side / 256
        expected = normalised(sampled(IMAGE, centre - side / 2, np.array([step, step]), 256, 256))
        assert shown.shape == (3, 256, 256)  # all columns: the network takes its middle ones itself
        inside = np.abs(shown - expected).max(0)
        assert np.median(inside) < 0.03
        assert inside.mean() < 0.12


def test_bgr_is_fed_only_with_the_option(recorded: Any) -> None:
    rgb, bgr = recorded(), recorded(channels="bgr")
    ask(rgb[0]), ask(bgr[0])
    grey = [(0.485, 0.229), (0.456, 0.224), (0.406, 0.225)]
    back = [np.stack([net.fed[0]["img"][:, c] * s + m for c, (m, s) in enumerate(grey)], 1) for net in (rgb[1], bgr[1])]
    assert np.allclose(back[0], back[1][:, ::-1], atol=1e-5)


def test_the_network_gets_the_box_relative_to_the_principal_point(recorded: Any) -> None:
    backend, network = recorded()
    ask(backend)
    fed = network.fed[0]
    for i, box in enumerate(BOXES):
        centre, side = square(box)
        height, width = fed["img_size"][i]
        assert (height, width) == (240, 320)  # rows first
        focal = fed["cam_int"][i, 0, 0]
        about = (fed["box_center"][i] - [width / 2, height / 2]) / focal
        assert np.allclose(about, (centre - [CAMERA.cx, CAMERA.cy]) / 400, atol=1e-5)
        assert np.isclose(fed["box_size"][i], side)


def test_weak_cameras_become_metres_by_its_own_formula(recorded: Any) -> None:
    backend, _ = recorded()
    centred = Intrinsics.from_focal(500.0, 320, 240)
    transl = ask(backend, centred).parameters.transl
    s, tx, ty = 0.9, 0.1, -0.2
    for row, box in zip(transl, BOXES, strict=True):
        centre, b = square(box)
        c = centre + 0.5  # its coordinates have integers at edges
        expected = [tx + 2 * (c[0] - 160) / (s * b), ty + 2 * (c[1] - 120) / (s * b), 2 * 500 / (b * s)]
        assert np.allclose(row, expected, atol=1e-5)


def test_the_given_camera_sets_the_depth(recorded: Any) -> None:
    near, far = (ask(recorded()[0], Intrinsics.from_focal(f, 320, 240)).parameters.transl for f in (300.0, 600.0))
    assert np.allclose(far[:, 2], 2 * near[:, 2])


def test_smpls_joints_0_to_21_are_returned_and_its_hands_left_out(recorded: Any) -> None:
    found = ask(recorded()[0])
    assert violations(BodyEstimator, found, people=2) == []
    assert found.body_model == "smpl"
    assert np.allclose(found.parameters.body_pose.reshape(2, 21, 3), [0.1, 0, 0], atol=1e-6)
    assert not found.parameters.left_hand_pose.any()
    assert found.joints is not None
    assert np.allclose(found.joints[:, :22], found.parameters.transl[:, None])
    assert np.isnan(found.joints[:, 22:]).all()


def test_keypoints_tell_which_joints_are_seen(recorded: Any) -> None:
    backend, _ = recorded()
    odd = Keypoints(np.zeros((2, 4, 2)), np.ones((2, 4)), Skeleton("odd", ("a", "b", "c", "d")))
    assert backend.infer(IMAGE, PEOPLE, CAMERA, odd, Hints()).observed is None
    points, confidence = np.full((2, 17, 2), 50.0), np.full((2, 17), 0.9)
    confidence[1, 13] = 0.45  # the left knee
    points[1, 16] = [400.0, 50.0]  # the right ankle, outside
    seen = Keypoints(points, confidence, "coco17")
    observed = backend.infer(IMAGE, PEOPLE, CAMERA, seen, Hints()).observed
    assert observed is not None
    assert observed[0, :22].all()
    assert np.flatnonzero(~observed[1, :22]).tolist() == [4, 8, 11]  # knee, ankle, and the foot that goes with it
    eager, _ = recorded(seen_confidence=0.4)
    observed = eager.infer(IMAGE, PEOPLE, CAMERA, seen, Hints()).observed
    assert observed is not None
    assert np.flatnonzero(~observed[1, :22]).tolist() == [8, 11]


def test_a_camera_that_sees_nothing_is_no_number(recorded: Any) -> None:
    found = ask(recorded(weak=(-0.1, 0.0, 0.0))[0])
    assert np.isnan(found.parameters.transl).all()


def test_many_people_come_in_batches_and_in_their_order(recorded: Any) -> None:
    backend, network = recorded(batch=1)
    together = ask(recorded()[0]).parameters.transl
    assert np.allclose(ask(backend).parameters.transl, together)
    assert len(network.fed) == 2


def test_an_export_without_joints_is_refused(stand_in_network: Any) -> None:
    outputs = {name: port for name, port in ANSWERS.items() if name != "joints"}
    with pytest.raises(BackendError, match="there is no output 'joints'"):
        CameraHmr().bind(stand_in_network(PORTS, outputs, lambda *_: {}))


def stand_in_camerahmr(stand_in: Any, stand_in_network: Any) -> type:
    """The adapter over a network that knows the embedded bodies of worlds, as if they were SMPL's."""

    def attach(backend: Any) -> list[Any]:
        def answer(shown: Any, feed: Any) -> dict[str, np.ndarray]:
            boxes = backend.next_boxes(len(feed["img"]))
            camera = backend.estimates[1]
            answers: dict[str, list[np.ndarray]] = {name: [] for name in ANSWERS}
            for picture, box in zip(feed["img"], boxes, strict=True):
                centre, side = region(box, 256, 256, 1.0)
                step = side / 256
                expected = normalised(sampled(shown.photo, centre - side / 2, step, 256, 256))
                assert np.abs(picture - expected).mean() < 0.1, "another picture than the network learned from"
                row = None if shown.world is None else whose(shown.world, box)
                if row is None:
                    vectors, joints, place = np.zeros((24, 3)), np.zeros((24, 3)), np.array([0.0, 0.0, 4.0])
                    vectors[0] = [np.pi, 0, 0]
                else:
                    p = shown.world.parameters
                    vectors = np.concatenate([p.global_orient[row], p.body_pose[row], np.zeros(6)]).reshape(24, 3)
                    place = p.transl[row]
                    joints = np.concatenate([shown.world.joints[row, :22], shown.world.joints[row, [25, 40]]]) - place
                s = 2 * camera.fx / (side[0] * place[2])
                middle = [camera.cx, camera.cy]
                shift = place[:2] - 2 * (centre - middle) / (s * side[0])
                matrices = Rotation.from_rotvec(vectors).as_matrix()
                for name, value in (
                    ("global_orient", matrices[:1]),
                    ("body_pose", matrices[1:]),
                    ("betas", np.zeros(10)),
                    ("pred_cam", np.array([s, *shift])),
                    ("joints", joints),
                ):
                    answers[name].append(value)
            return {name: np.stack(rows) for name, rows in answers.items()}

        network = stand_in_network(PORTS, ANSWERS, answer)
        backend.bind(network)
        return [network]

    return stand_in(CameraHmr, attach)  # type: ignore[no-any-return]


def test_conformance(stand_in: Any, stand_in_network: Any) -> None:
    report = check_backend(stand_in_camerahmr(stand_in, stand_in_network), "body_estimator")
    print(report.summary, report.accuracy)
    report.raise_if_failed()


def test_the_joints_of_a_world_come_back(stand_in: Any, stand_in_network: Any) -> None:
    from physic_testing.worlds import build_world

    world = build_world("group", 0, (320, 240))
    backend = stand_in_camerahmr(stand_in, stand_in_network)()
    backend.load()
    people = People(world.masks, world.boxes, np.ones(len(world.boxes)))
    found = backend.infer(world.image, people, world.intrinsics, NO_KEYPOINTS, Hints())
    assert np.abs(found.joints[:, :22] - world.joints[:, :22]).max() < 1e-4
    assert np.allclose(found.parameters.transl, world.parameters.transl, atol=1e-4)
