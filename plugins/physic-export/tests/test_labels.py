"""COCO and HOT JSON."""

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
from physic_core.body import load_body
from physic_export.hot import HOT_PARTS, hot_part_of_vertex
from physic_export.rle import run_lengths


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


def test_hot_parts_lie_where_their_names_say():
    body = load_body()
    parts = hot_part_of_vertex(body)
    rest = body(*body.zero_pose()).vertices[0].numpy()
    centre = {name: rest[parts == number].mean(0) for number, name in enumerate(HOT_PARTS)}
    order = ["leftfoot", "leftcalf", "leftthigh", "hip", "chest", "head"]
    heights = [centre[name][1] for name in order]
    assert heights == sorted(heights)
    assert centre["back"][2] < centre["chest"][2]
    assert centre["butt"][2] < centre["hip"][2]
    assert centre["lefthand"][0] > centre["leftforearm"][0] > centre["leftupperarm"][0] > 0
    assert [HOT_PARTS.index(name) + 1 for name in ("head", "back", "butt", "rightfoot")] == [1, 3, 10, 17]


def test_hot_lists_the_contact_of_people_who_sit(export, result: Reconstruction):
    made = document(export("a.json", "hot").files)
    assert made["imsize"] == {"width": 160, "height": 120}
    assert made["filename"] == "a.png"
    for person in made["people"]:
        truth = result.people[person["person"]]
        own = [index for index, partner in enumerate(result.contact_partners) if partner.kind == "self"]
        outward = truth.contact & ~np.isin(truth.contact_partner, own)
        assert sum(part["vertices"] for part in person["parts"].values()) == outward.sum()
        assert all(0 < part["share"] <= 1 and part["area_m2"] > 0 for part in person["parts"].values())
    assert {"butt", "leftthigh"} & set(made["people"][0]["parts"])
    for one in made["object"]:
        assert one["semantic_label"] == HOT_PARTS[one["semantic_id"] - 1]
        person = result.people[one["person"]]
        touching = person.vertices[person.contact].astype(float) @ result.intrinsics.matrix.T
        low, high = np.min(touching[:, :2] / touching[:, 2:], 0), np.max(touching[:, :2] / touching[:, 2:], 0)
        assert low[0] - 2 <= min(one["polygon"]["x"]) <= max(one["polygon"]["x"]) <= high[0] + 2
        assert low[1] - 2 <= min(one["polygon"]["y"]) <= max(one["polygon"]["y"]) <= high[1] + 2
