"""RTMO: the canvas that it is shown, whose pose is whose, and the whole kit on stand-ins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_onnx.rtmo import Rtmo, assign_poses
from physic_testing.conformance import check_backend

from .pose_worlds import joints, people

PLACES = np.random.default_rng(0).uniform(20, 400, (2, 17, 2))


@pytest.fixture
def rtmo(tmp_path: Path, graph: Any, node: Any) -> Any:
    """A file that answers two held poses, and, as the scores of the first, values of what it was shown over 255."""

    def make(boxes: list[list[float]], scores: tuple[float, ...] = (0.9, 0.8), count: int = 17, **options: Any) -> Rtmo:
        found = len(boxes)
        held = np.concatenate([PLACES[:found, :count], np.full((found, count, 1), 0.7)], -1)[None].astype(np.float32)
        dets = np.concatenate([np.array(boxes, np.float32), np.array(scores[:found])[:, None]], -1)[None]
        path = graph(
            tmp_path / "end2end.onnx",
            {"input": ("float32", ("batch", 3, 640, 640))},
            {"dets": ("float32", ("batch", "found", 5)), "keypoints": ("float32", ("batch", "found", count, 3))},
            [
                # three values of the canvas become the scores of the first three joints of the first pose
                node("GatherND", ["input", "looked at"], ["values"]),
                node("Div", ["values", "white"], ["shares"]),
                node("ScatterND", ["held", "scores of", "shares"], ["keypoints"]),
                node("Identity", ["boxes"], ["dets"]),
            ],
            {
                "held": held,
                "boxes": dets.astype(np.float32),
                "white": np.array(255, np.float32),
                "looked at": np.array([[0, 0, 5, 5], [0, 2, 5, 5], [0, 1, 639, 320]]),
                "scores of": np.array([[0, 0, 0, 2], [0, 0, 1, 2], [0, 0, 2, 2]]),
            },
        )
        backend = Rtmo(Rtmo.Options(weights=str(path), **options))
        backend.load()
        return backend

    return make


def test_points_come_back_into_the_photo_between_pixel_centres(rtmo: Any) -> None:
    found = rtmo([[0, 0, 640, 480]]).infer(np.zeros((240, 320, 3), np.uint8), people((0, 0, 320, 240), size=(240, 320)))
    assert np.allclose(found.points[0], (PLACES[0] + 0.5) / 2 - 0.5, atol=1e-4)


def test_each_person_gets_the_pose_that_overlaps_most(rtmo: Any) -> None:
    photo = np.zeros((240, 320, 3), np.uint8)
    backend = rtmo([[0, 0, 200, 400], [300, 0, 500, 400]])
    found = backend.infer(photo, people((150, 0, 250, 200), (0, 0, 100, 200), (260, 0, 320, 100), size=(240, 320)))
    assert np.allclose(found.points[0], (PLACES[1] + 0.5) / 2 - 0.5, atol=1e-4)
    assert np.allclose(found.points[1], (PLACES[0] + 0.5) / 2 - 0.5, atol=1e-4)
    assert (found.confidence[2] == 0).all()  # nobody's pose
    assert np.isfinite(found.points).all()


def test_no_pose_is_given_twice() -> None:
    boxes = np.array([[0.0, 0, 10, 10], [0, 0, 10, 12]])
    assert assign_poses(boxes, np.array([[0.0, 0, 10, 12]]), 0.3).tolist() == [-1, 0]
    assert assign_poses(boxes, np.zeros((0, 4)), 0.3).tolist() == [-1, -1]
    assert assign_poses(boxes, np.array([[9.0, 9, 20, 20]]), 0.3).tolist() == [-1, -1]


def test_poses_of_low_confidence_are_given_to_no_person(rtmo: Any) -> None:
    photo = np.zeros((240, 320, 3), np.uint8)
    backend = rtmo([[0, 0, 640, 480]], scores=(0.05,))
    assert (backend.infer(photo, people((0, 0, 320, 240), size=(240, 320))).confidence == 0).all()


def test_another_joint_set_is_refused(rtmo: Any) -> None:
    with pytest.raises(BackendError, match="returns 14 joints, and RTMO's 17 of COCO were expected"):
        rtmo([[0, 0, 640, 480]], count=14)


def stand_in_rtmo(stand_in: Any, stand_in_network: Any) -> type:
    def attach(backend: Any) -> list[Any]:
        def answer(shown: Any, feed: Any) -> dict[str, np.ndarray]:
            height, width = shown.photo.shape[:2]
            ratio = min(640 / height, 640 / width)
            inner = feed["input"][0, :, : int(height * ratio), : int(width * ratio)]
            assert np.abs(inner.mean((1, 2)) - shown.photo[..., ::-1].mean((0, 1))).max() < 2, "not BGR from 0 to 255"
            boxes = backend.estimates[0].boxes if shown.world is None else shown.world.boxes
            poses = [joints(shown.world, box, "coco17") for box in boxes]
            order = np.arange(len(boxes))[::-1]  # the network's own order
            points = np.stack([(p + 0.5) * ratio - 0.5 for p, _ in poses])[order]
            sure = np.stack([s for _, s in poses])[order]
            return {
                "dets": np.concatenate([boxes[order] * ratio, np.full((len(boxes), 1), 0.9)], -1)[None],
                "keypoints": np.concatenate([points, sure[..., None]], -1)[None],
            }

        network = stand_in_network(
            {"input": ("float32", (1, 3, 640, 640))},
            {"dets": ("float32", (1, "n", 5)), "keypoints": ("float32", (1, "n", 17, 3))},
            answer,
        )
        backend.bind(network)
        return [network]

    return stand_in(Rtmo, attach)  # type: ignore[no-any-return]


def test_conformance(stand_in: Any, stand_in_network: Any) -> None:
    report = check_backend(stand_in_rtmo(stand_in, stand_in_network), "keypoint_detector")
    print(report.summary, report.accuracy)
    report.raise_if_failed()
    assert report.accuracy["px"] < 1.0
