"""ViTPose: both forms of the file, colours, and the grid of its heat maps."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector
from physic_onnx.vitpose import VitPose
from physic_testing import violations

from .pose_worlds import BOX, PLACES, blobs, people

HEIGHT = 256
WIDTH = 192
PORTS = {
    "easy": ("input_0", "output_0", False),
    "hub": ("pixel_values", "heatmaps", False),
    "plus": ("pixel_values", "heatmaps", True),
}


@pytest.fixture
def vitpose(tmp_path, graph, node, loaded):
    """A file whose joint j is the colour j mod 3 of what it is shown, on the grid that such a
    network is trained on.

    COCO's 17 joints: first and last cell are first and last pixel (UDP). All others: cell q is
    pixel 4 q.
    """

    def make(
        kind="easy",
        count=17,
        batch="batch",
        stated=True,
        **options,
    ):
        picture, maps, plus = PORTS[kind]
        inputs = {picture: ("float32", (batch, 3, HEIGHT, WIDTH))}
        nodes = [
            node("Gather", [picture, "colours"], ["gathered"], axis=1),
            node(
                "Resize",
                ["gathered", "", "", "size"],
                ["small"],
                mode="linear",
                coordinate_transformation_mode="align_corners" if count == 17 else "asymmetric",
            ),
        ]
        if plus:
            inputs["dataset_index"] = ("int64", (batch,))
            nodes += [
                node("Cast", ["dataset_index"], ["index"], to=1),
                node("Reshape", ["index", "column"], ["expert"]),
                node("Add", ["small", "expert"], [maps]),
            ]
        else:
            nodes.append(node("Identity", ["small"], [maps]))
        constants = {"colours": np.arange(count) % 3} | (
            {"column": np.array([-1, 1, 1, 1])} if plus else {}
        )
        size = (HEIGHT // 4, WIDTH // 4)
        constants |= {
            "rest": np.array([count, *size]),
            "zero": np.array([0]),
            "one": np.array([1]),
        }
        nodes = [
            node("Shape", [picture], ["shape"]),
            node("Slice", ["shape", "zero", "one"], ["rows"]),
            node("Concat", ["rows", "rest"], ["size"], axis=0),
            *nodes,
        ]
        joints = count if stated else "joints"
        path = graph(
            tmp_path / "net.onnx",
            inputs,
            {maps: ("float32", (batch, joints, *size))},
            nodes,
            constants,
        )
        return loaded(VitPose, path, **options)

    return make


@pytest.mark.parametrize("kind", list(PORTS))
def test_each_joint_is_found_at_the_blob_of_its_colour(vitpose, kind):
    found = vitpose(kind).infer(blobs(PLACES), people(BOX))
    assert violations(KeypointDetector, found, people=1) == []
    assert found.skeleton == "coco17"
    apart = np.linalg.norm(found.points[0, :3] - PLACES, axis=1)
    assert apart.max() < 0.35  # half a pixel of the input would be 0.4 px, red for blue 90 px


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize(
    ("count", "skeleton"), [(17, "coco17"), (26, "halpe26"), (133, "coco_wholebody133")]
)
def test_each_joint_set_is_read_on_the_grid_that_it_was_trained_on(
    vitpose, count, skeleton, stated
):
    box = (300.0, 60.0, 560.0, 700.0)
    backend = vitpose(count=count, stated=stated)
    for places in (
        [(430.0, 80.0), (320.0, 250.0), (540.0, 690.0)],
        [(540.0, 380.0), (430.0, 360.0), (320.0, 640.0)],
    ):
        found = backend.infer(blobs(places, (760, 900), sigma=30.0), people(box, size=(760, 900)))
        assert found.skeleton == skeleton
        # read on the other grid, a foot is 10 px off
        assert np.linalg.norm(found.points[0, :3] - places, axis=1).max() < 1.0


@pytest.mark.parametrize(("count", "expert"), [(17, 0), (133, 5)])
def test_vitpose_plus_gets_the_expert_of_its_joint_set(vitpose, count, expert):
    """The fake network adds the number of its expert to its heat maps."""
    black = np.zeros((200, 260, 3), np.uint8)  # -2.1 to -1.8 after the normalisation
    assert (vitpose("plus", count).infer(black, people(BOX)).confidence == min(expert, 1)).all()


@pytest.mark.parametrize("stated", [True, False])
def test_keypoints_of_one_hand_are_refused(vitpose, stated):
    with pytest.raises(BackendError, match=r"returns 21 keypoints a person.*those of one hand"):
        vitpose(count=21, stated=stated)


@pytest.mark.parametrize("batch", [1, "batch"])
def test_people_do_not_depend_on_their_batch(vitpose, batch):
    seen = blobs(PLACES)
    boxes = [(60.0 + i, 40.0, 140.0, 170.0) for i in range(5)]
    together = vitpose(batch=batch).infer(seen, people(*boxes))
    alone = [vitpose(batch=batch).infer(seen, people(box)) for box in boxes]
    assert np.allclose(together.points, np.concatenate([one.points for one in alone]), atol=1e-6)
