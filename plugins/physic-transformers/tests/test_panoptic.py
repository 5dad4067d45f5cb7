"""Panoptic queries to people and the floor, against the library's own processor."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from physic_transformers.eomt import (
    COCO_PANOPTIC,
    FLOOR_CLASSES,
    PORTABLE_CLASSES,
    PaddedFrame,
    people_and_floor,
)

PERSON, FLOOR_OTHER, WALL = (
    COCO_PANOPTIC.index(name) for name in ("person", "floor-other-merged", "wall-other-merged")
)


def queries(labels, masks, sure=12.0):
    classes = np.zeros((len(labels), 134), np.float32)
    classes[np.arange(len(labels)), labels] = sure
    return classes, np.where(np.stack(masks), 8.0, -8.0).astype(np.float32)


def box(y0, y1, x0, x1, side=16):
    mask = np.zeros((side, side), bool)
    mask[y0:y1, x0:x1] = True
    return mask


def same(grid):
    return grid


def test_classes_have_the_numbers_of_coco_panoptic():
    """Numbers of the label lists that published checkpoints carry."""
    known = {
        0: "person", 56: "chair", 57: "couch", 79: "toothbrush", 80: "banner", 87: "floor-wood",
        96: "platform", 97: "playingfield", 100: "road", 102: "sand", 105: "snow",
        122: "floor-other-merged", 123: "pavement-merged", 125: "grass-merged", 126: "dirt-merged",
        132: "rug-merged",
    }  # fmt: skip
    assert len(COCO_PANOPTIC) == len(set(COCO_PANOPTIC)) == 133
    assert {i: COCO_PANOPTIC[i] for i in known} == known
    assert set(COCO_PANOPTIC) > FLOOR_CLASSES
    assert set(COCO_PANOPTIC[:80]) > PORTABLE_CLASSES


def test_people_and_floor_get_separate_masks():
    left = box(2, 12, 1, 5)
    right = box(3, 13, 9, 12)
    floor = box(10, 16, 0, 16)
    classes, masks = queries(
        [PERSON, FLOOR_OTHER, PERSON, WALL], [left, floor & ~left & ~right, right, box(0, 2, 0, 16)]
    )
    classes[2, PERSON] = 9.0
    people = people_and_floor(classes, masks, same, (16, 16))
    assert len(people) == 2
    assert (people.masks[0] == left).all()
    assert (people.masks[1] == right).all()
    assert people.floor is not None
    assert (people.floor == (floor & ~left & ~right)).all()


def test_each_portable_thing_is_an_object():
    ball, cup, chair, held = (
        COCO_PANOPTIC.index(name) for name in ("sports ball", "cup", "chair", "person")
    )
    classes, masks = queries(
        [ball, cup, chair, held],
        [box(1, 4, 1, 4), box(6, 8, 2, 3), box(9, 15, 9, 15), box(2, 9, 3, 6)],
    )
    classes[3, held] = 14.0
    found = people_and_floor(classes, masks, same, (16, 16), held=0.3)
    assert found.objects is not None
    assert (found.objects == np.stack([box(1, 4, 1, 4) & ~found.masks[0], box(6, 8, 2, 3)])).all()


def test_objects_are_none_only_if_the_network_has_no_object_classes():
    classes, masks = queries([PERSON], [box(4, 8, 4, 8)])
    known = people_and_floor(classes, masks, same, (16, 16)).objects
    assert known is not None
    assert known.shape == (0, 16, 16)
    names = ("person", "wall-wood")
    assert (
        people_and_floor(classes[:, [0, 1, 133]], masks, same, (16, 16), labels=names).objects
        is None
    )


def test_a_second_query_of_one_person_is_dropped():
    classes, masks = queries([PERSON, PERSON], [box(4, 12, 4, 12), box(4, 12, 4, 11)])
    classes[1, PERSON] = 7.0
    assert len(people_and_floor(classes, masks, same, (16, 16))) == 1


@pytest.mark.parametrize(
    "size", [(48, 64), (97, 131), (131, 97), (640, 640), (24, 32), (333, 1000)]
)
def test_the_frame_is_filled_as_the_library_fills_it(size):
    processor = eomt_processor()
    made = processor.preprocess(np.full((*size, 3), 255, np.uint8), return_tensors="np")[
        "pixel_values"
    ][0]
    filled = made[0] > 0
    inner = PaddedFrame(*size, 640).inner
    assert filled[: inner[0], : inner[1]].all()
    assert filled.sum() == inner[0] * inner[1]


@pytest.mark.parametrize("size", [(60, 83), (91, 64)])
def test_segments_are_those_of_the_library(size):
    torch = pytest.importorskip("torch")
    processor = eomt_processor()
    rng = np.random.default_rng(3)
    labels = [PERSON, PERSON, PERSON, FLOOR_OTHER, WALL, 133, PERSON, COCO_PANOPTIC.index("road")]
    masks = rng.normal(0, 4, (8, 6, 6)).repeat(4, 1).repeat(4, 2).astype(np.float32)
    classes = rng.normal(0, 1, (8, 134)).astype(np.float32)
    classes[np.arange(8), labels] += rng.uniform(6, 12, 8).astype(np.float32)
    said = {
        "masks_queries_logits": torch.tensor(masks)[None],
        "class_queries_logits": torch.tensor(classes)[None],
    }
    published = processor.post_process_panoptic_segmentation(
        SimpleNamespace(**said),
        target_sizes=[size], threshold=0.5, overlap_mask_area_threshold=0.3, stuff_classes=list(range(80, 133)),  # noqa: E501
        size={"shortest_edge": 640, "longest_edge": 640},
    )[0]  # fmt: skip
    segmentation = published["segmentation"].numpy()
    wanted = {
        s["score"]: segmentation == s["id"]
        for s in published["segments_info"]
        if s["label_id"] == PERSON
    }
    floor = np.isin(
        segmentation,
        [
            s["id"]
            for s in published["segments_info"]
            if COCO_PANOPTIC[s["label_id"]] in FLOOR_CLASSES
        ],
    )
    people = people_and_floor(
        classes, masks, PaddedFrame(*size, 640).to_photo, size, threshold=0.5, held=0.3
    )
    assert len(people) == len(wanted) > 1
    for mask, score in zip(people.masks, people.scores, strict=True):
        (theirs,) = [m for s, m in wanted.items() if abs(s - score) < 2e-6]
        assert (mask != theirs).mean() < 2e-3
    assert people.floor is not None
    assert (people.floor != floor).mean() < 2e-3


def eomt_processor():
    transformers = pytest.importorskip("transformers")
    return transformers.EomtImageProcessorPil(do_pad=True)
