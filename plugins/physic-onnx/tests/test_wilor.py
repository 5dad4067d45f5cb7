"""WiLoR: BGR or RGB as the file wants, left hands in a mirror, and the kit on stand-ins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core.errors import BackendError
from physic_core.interfaces import HandEstimator
from physic_core.types import Keypoints, People
from physic_onnx.wilor import MINI, ORIGINAL, Wilor
from physic_testing import violations, world_of
from physic_testing.conformance import check_backend

from .pose_worlds import sampled

PICTURES = {MINI: ("float32", ("b", 256, 256, 3)), ORIGINAL: ("float32", ("b", 3, 256, 256))}
MEAN, STD = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
IMAGE = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
PEOPLE = People(np.zeros((1, 240, 320), bool), np.array([[20.0, 20, 300, 230]]), np.ones(1))


def hands_at(left: np.ndarray, right: np.ndarray, sure: tuple[float, float] = (0.9, 0.8)) -> Keypoints:
    """Whole-body keypoints of which only the hands are seen: boxes (4,) x0 y0 x1 y1 of their points."""
    points, confidence = np.zeros((1, 133, 2)), np.zeros((1, 133))
    share = np.random.default_rng(1).random((21, 2))
    share[:2] = [[0, 0], [1, 1]]
    for start, box, own in ((91, left, sure[0]), (112, right, sure[1])):
        points[0, start : start + 21] = box[:2] + share * (box[2:] - box[:2])
        confidence[0, start : start + 21] = own
    return Keypoints(points, confidence, "coco_wholebody133")


LEFT, RIGHT = np.array([60.0, 80, 120, 130]), np.array([180.0, 100, 240, 170])


@pytest.fixture
def recorded(stand_in_network: Any) -> Any:
    """The adapter, and what its network was fed; hand i of those fed turns its joints by (0.1 (i + 1), 0.2, 0.3)."""

    def make(signature: str = MINI, matrices: bool = False, **options: Any) -> tuple[Wilor, list[np.ndarray]]:
        fed: list[np.ndarray] = []
        backend = Wilor(Wilor.Options(**options))
        shape = ("b", 15, 3, 3) if matrices else ("b", 15, 3)
        network = stand_in_network(
            {"image": PICTURES[signature]},
            {"hand_pose": ("float32", shape), "global_orient": ("float32", ("b", 1, *shape[2:]))},
            lambda *_: {},
        )

        def run(feed: Any, outputs: Any) -> list[np.ndarray]:
            fed.append(feed["image"])
            n = len(feed["image"])
            first = 0.1 * (np.arange(n) + 1 + sum(len(f) for f in fed[:-1]))
            vectors = np.stack([first, np.full(n, 0.2), np.full(n, 0.3)], -1)[:, None].repeat(16, 1)
            rotations = (
                Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(n, 16, 3, 3) if matrices else vectors
            )
            parts = {"hand_pose": rotations[:, 1:], "global_orient": rotations[:, :1]}
            return [parts[name].astype(np.float32) for name in outputs]

        network.run = run
        backend.bind(network)
        return backend, fed

    return make


def crop_of_hand(photo: np.ndarray, box: np.ndarray, mirrored: bool, margin: float = 2.5) -> np.ndarray:
    """(256, 256, 3) RGB as the checkout crops: the photo is mirrored, then the box (4,) of the hand's points in it."""
    side = margin * (box[2:] - box[:2]).max()
    centre = (box[:2] + box[2:]) / 2
    if mirrored:
        photo, centre = photo[:, ::-1], np.array([photo.shape[1] - 1 - centre[0], centre[1]])
    step = side / 256
    return sampled(photo, centre - side / 2, np.array([step, step]), 256, 256)


def grey_levels(fed: np.ndarray, signature: str) -> np.ndarray:
    """What was fed of one hand, (256, 256, 3) RGB."""
    return fed[..., ::-1] if signature == MINI else (fed.transpose(1, 2, 0) * STD + MEAN) * 255


@pytest.mark.parametrize("signature", [MINI, ORIGINAL])
def test_colours_come_as_the_file_wants_them_and_left_hands_in_a_mirror(recorded: Any, signature: str) -> None:
    backend, fed = recorded(signature)
    assert backend.loaded().signature == signature
    backend.infer(IMAGE, PEOPLE, hands_at(LEFT, RIGHT))
    assert fed[0].shape == ((2, 256, 256, 3) if signature == MINI else (2, 3, 256, 256))
    for shown, box, mirrored in zip(fed[0], (LEFT, RIGHT), (True, False), strict=True):
        apart = np.abs(grey_levels(shown, signature) - crop_of_hand(IMAGE, box, mirrored))
        assert np.median(apart) < 4  # noise of one pixel, sampled at 1/32 of one
        assert np.abs(grey_levels(shown, signature) - crop_of_hand(IMAGE, box, not mirrored)).mean() > 5 * apart.mean()


def test_swapping_channels_is_a_switch(recorded: Any) -> None:
    shown = [
        make[1]
        for make in (recorded(), recorded(swap_channels=True))
        if make[0].infer(IMAGE, PEOPLE, hands_at(LEFT, RIGHT))
    ]
    assert np.array_equal(shown[0][0], shown[1][0][..., ::-1])


@pytest.mark.parametrize("matrices", [False, True])
def test_left_hands_are_mirrored_back_and_come_first(recorded: Any, matrices: bool) -> None:
    found = recorded(ORIGINAL, matrices)[0].infer(IMAGE, PEOPLE, hands_at(LEFT, RIGHT))
    assert violations(HandEstimator, found, people=1) == []
    assert np.allclose(found.rotvecs[0, 0], [0.1, -0.2, -0.3], atol=1e-5)
    assert np.allclose(found.rotvecs[0, 1], [0.2, 0.2, 0.3], atol=1e-5)
    assert found.wrists is not None
    assert np.allclose(found.wrists[0], [[0.1, -0.2, -0.3], [0.2, 0.2, 0.3]], atol=1e-5)
    assert np.allclose(found.confidence, [[0.9, 0.8]])


def test_unsure_and_small_hands_are_left_out(recorded: Any) -> None:
    found = recorded()[0].infer(IMAGE, PEOPLE, hands_at(LEFT, RIGHT, (0.9, 0.2)))
    assert found.confidence[0].tolist() == pytest.approx([0.9, 0.0])
    tiny = np.array([60.0, 80, 70, 90])
    backend, fed = recorded()
    assert not backend.infer(IMAGE, PEOPLE, hands_at(tiny, tiny)).confidence.any()
    assert not fed  # the network is not even asked


def test_another_number_of_joints_is_refused(stand_in_network: Any) -> None:
    backend = Wilor()
    network = stand_in_network({"image": PICTURES[MINI]}, {"hand_pose": ("float32", ("b", 16, 3))}, lambda *_: {})
    network.run = lambda feed, outputs: [np.zeros((len(feed["image"]), 16, 3), np.float32)]
    backend.bind(network)
    with pytest.raises(BackendError, match="where 2 hands have 15 rotations each"):
        backend.infer(IMAGE, PEOPLE, hands_at(LEFT, RIGHT))


def turned_wrist(parameters: Any, row: int, side: int) -> np.ndarray:
    """(3,) rotation vector of a hand from the T-pose to the camera: all joints from the pelvis to the wrist."""
    vectors = np.concatenate([parameters.global_orient[row], parameters.body_pose[row]]).reshape(22, 3)
    chain = (0, 3, 6, 9, 13 + side, 16 + side, 18 + side, 20 + side)  # spine, collar, shoulder, elbow, wrist
    whole = Rotation.identity()
    for joint in chain:
        whole = whole * Rotation.from_rotvec(vectors[joint])
    return whole.as_rotvec()


def stand_in_wilor(stand_in: Any, stand_in_network: Any) -> type:
    """The adapter over a network that knows the fingers of the world's people, and right hands only."""

    def attach(backend: Any) -> list[Any]:
        def answer(shown: Any, feed: Any) -> dict[str, np.ndarray]:
            fingers, wrists = np.zeros((len(feed["image"]), 15, 3)), np.zeros((len(feed["image"]), 1, 3))
            for i, picture in enumerate(feed["image"]):
                if shown.world is None:
                    continue
                row, side = _recognised(shown, picture[..., ::-1])
                p = shown.world.parameters
                own = (p.left_hand_pose, p.right_hand_pose)[side][row].reshape(15, 3)
                mirror = [1, 1, 1] if side else [1, -1, -1]
                fingers[i], wrists[i] = own * mirror, turned_wrist(p, row, side) * mirror
            return {"hand_pose": fingers, "global_orient": wrists}

        def _recognised(shown: Any, picture: np.ndarray) -> tuple[int, int]:
            """Whose hand a picture shows, and which: the one around whose wrist the photo looks like this."""
            best = (np.inf, 0, 0)
            for row, hands in enumerate(backend.places):
                for side, box in enumerate(hands):
                    apart = np.abs(crop_of_hand(shown.photo, box, mirrored=side == 0) - picture).mean()
                    best = min(best, (float(apart), row, side))
            assert best[0] < 4, f"no hand looks like this: {best[0]:.1f} grey levels"
            return backend.rows[best[1]], best[2]

        network = stand_in_network(
            {"image": PICTURES[MINI]},
            {"hand_pose": ("float32", ("b", 15, 3)), "global_orient": ("float32", ("b", 1, 3))},
            answer,
        )
        backend.bind(network)
        return [network]

    class StandIn(stand_in(Wilor, attach)):  # type: ignore[misc]
        def infer(self, image: np.ndarray, people: People, keypoints: Keypoints) -> Any:
            from physic_core.adapters.hand_boxes import hand_boxes

            found = hand_boxes(keypoints, least_confidence=0.0, least_size_px=0.0)
            self.places = [
                [b - 0.5 for p, b in zip(found.person, found.boxes, strict=True) if p == i] for i in range(len(people))
            ]
            self.rows = list(range(len(people)))
            world = world_of(image) if isinstance(image, np.ndarray) and image.ndim == 3 else None
            if world is not None:
                self.rows = [int(np.abs(world.boxes - box).max(1).argmin()) for box in people.boxes]
            return super().infer(image, people, keypoints)

    return StandIn


def test_conformance(stand_in: Any, stand_in_network: Any) -> None:
    options = {"least_size_px": 8.0, "least_confidence": 0.3}
    report = check_backend(stand_in_wilor(stand_in, stand_in_network), "hand_estimator", options=options)
    print(report.summary, report.accuracy)
    report.raise_if_failed()
    assert report.accuracy["degrees"] < 1


def test_large_hands_are_smoothed_before_they_shrink(recorded: Any) -> None:
    from scipy.ndimage import gaussian_filter

    photo = np.random.default_rng(2).integers(0, 256, (1100, 1100, 3), np.uint8)
    box = np.array([350.0, 350, 750, 750])
    backend, fed = recorded()
    backend.infer(photo, PEOPLE, hands_at(box, box))
    sigma = (1000 / 256 / 2 - 1) / 2  # the checkout's: half of the shrinking, less one, halved
    smooth = gaussian_filter(photo.astype(float), (sigma, sigma, 0), mode="nearest", truncate=4)
    apart = [np.abs(fed[0][1, ..., ::-1] - crop_of_hand(p, box, mirrored=False)).mean() for p in (smooth, photo)]
    print(f"grey levels from the smoothed photo {apart[0]:.1f}, from the photo {apart[1]:.1f}")
    assert apart[0] < 0.2 * apart[1]
