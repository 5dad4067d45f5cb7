"""COCO: pycocotools reads the keypoints, boxes and masks of the result, in px of the photo file."""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace

import numpy as np
import pytest

from physic_core.types import Lens

# of pycocotools
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")


def opened(file):
    coco = pytest.importorskip("pycocotools.coco")
    with contextlib.redirect_stdout(io.StringIO()):
        return coco.COCO(str(file))


@pytest.fixture
def thrice(result):
    """The result of a photo file of three times its size."""
    width = result.intrinsics.width
    height = result.intrinsics.height
    return replace(result, file_size=(3 * width, 3 * height), photo_name="a.jpg")


def test_pycocotools_reads_the_keypoints_and_boxes_of_every_person(export, thrice):
    data = opened(export("a.json", "coco", of=thrice).files[0])
    assert data.imgs[1]["file_name"] == "a.jpg"
    assert (data.imgs[1]["width"], data.imgs[1]["height"]) == thrice.file_size
    for index, person in enumerate(thrice.people):
        (annotation,) = (one for one in data.loadAnns(data.getAnnIds()) if one["person"] == index)
        triples = np.array(annotation["keypoints"], float).reshape(-1, 3)
        is_visible = person.keypoint_confidence > 0
        np.testing.assert_allclose(
            triples[is_visible, :2], 3 * person.keypoints[is_visible] + 1, atol=1e-3
        )
        assert (triples[is_visible, 2] == 2).all()
        assert not triples[~is_visible].any()
        assert annotation["num_keypoints"] == is_visible.sum()
        np.testing.assert_allclose(
            annotation["keypoint_scores"], person.keypoint_confidence, atol=1e-4
        )
        x, y, width, height = annotation["bbox"]
        np.testing.assert_allclose([x, y, x + width, y + height], 3 * person.box, atol=1e-3)


def test_pycocotools_decodes_the_masks(export, thrice):
    data = opened(export("a.json", "coco", of=thrice).files[0])
    for index, person in enumerate(thrice.people):
        mask = data.annToMask(data.anns[index + 1])
        np.testing.assert_array_equal(mask, np.kron(person.mask, np.ones((3, 3), bool)))
        assert data.anns[index + 1]["area"] == mask.sum()


def test_masks_of_an_undistorted_photo_are_those_of_its_file(export, result):
    camera = result.intrinsics
    lens = Lens(replace(camera, fx=0.9 * camera.fx, fy=0.9 * camera.fy), (0.1, 0.0, 0.0, 0.0, 0.0))
    data = opened(export("a.json", "coco", of=replace(result, lens=lens)).files[0])
    person = result.people[0]
    mask = data.annToMask(data.anns[1]).astype(bool)
    columns, rows = (
        np.rint(lens.file_pixels(np.argwhere(person.mask)[:, ::-1], camera)).astype(int).T
    )
    there = (rows >= 0) & (rows < mask.shape[0]) & (columns >= 0) & (columns < mask.shape[1])
    assert mask[rows[there], columns[there]].mean() > 0.98
    assert mask.sum() == pytest.approx(0.81 * person.mask.sum(), rel=0.1)


def test_a_person_whom_the_photo_does_not_show_has_no_annotation(export, result):
    hidden = replace(
        result.people[0], mask=np.zeros_like(result.people[0].mask), box=np.zeros(4, np.float32)
    )
    done = export("a.json", "coco", of=replace(result, people=(hidden, *result.people[1:])))
    assert [one["person"] for one in opened(done.files[0]).anns.values()] == [1]
    assert any(note.startswith("person 0") for note in done.notes)
