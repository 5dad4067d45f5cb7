"""COCO JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from physic_core import Reconstruction
from physic_export.coco import run_lengths


def document(files: tuple[Path, ...]) -> dict:
    return json.loads(next(path for path in files if path.suffix == ".json").read_text())


@given(arrays(bool, st.tuples(st.integers(1, 6), st.integers(1, 6))))
def test_run_lengths_spell_the_mask(mask: np.ndarray):
    made = run_lengths(mask)
    values = np.concatenate([np.full(n, k % 2 == 1) for k, n in enumerate(made["counts"])])
    np.testing.assert_array_equal(values.reshape(mask.shape[::-1]).T, mask)


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # in pycocotools 2.0.11
def test_pycocotools_reads_masks_and_boxes(export, result: Reconstruction, capsys: pytest.CaptureFixture[str]):
    coco = pytest.importorskip("pycocotools.coco")
    masks = pytest.importorskip("pycocotools.mask")
    files = export("a.json", "coco").files
    data = coco.COCO(str(files[0]))
    capsys.readouterr()  # it prints
    (image,) = data.loadImgs(data.getImgIds())
    np.testing.assert_array_equal(np.asarray(Image.open(files[0].with_name(image["file_name"]))), result.image)
    found = data.loadAnns(data.getAnnIds(catIds=data.getCatIds(["person"])))
    assert len(found) == 2
    for one in found:
        person = result.people[one["person"]]
        np.testing.assert_array_equal(data.annToMask(one).astype(bool), person.mask)
        assert one["area"] == masks.area(data.annToRLE(one))
        x, y, width, height = one["bbox"]
        np.testing.assert_allclose([x, y, x + width, y + height], person.box, atol=0.01)


def test_coco_keypoints_are_those_of_the_detector(export, result: Reconstruction):
    first = document(export("a.json", "coco").files)
    names = first["categories"][0]["keypoints"]
    assert names[:3] == ["nose", "left_eye", "right_eye"]
    assert len(names) == 17
    person, own = result.people[0], result.skeleton.names
    for number, name in enumerate(names):
        x, y, seen = first["annotations"][0]["keypoints"][3 * number : 3 * number + 3]
        row = own.index(name if name in own else f"{name}_surface")
        confidence = person.keypoint_confidence[row]
        assert seen == (0 if confidence == 0 else 1 if confidence < 0.5 else 2)
        if seen:
            np.testing.assert_allclose([x, y], person.keypoints[row], atol=0.01)
    lost = replace(person, vertices=np.full_like(person.vertices, np.nan))
    bodiless = replace(result, people=(lost,))
    assert document(export("b.json", "coco", of=bodiless).files)["annotations"] == first["annotations"][:1]
