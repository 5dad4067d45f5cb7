"""Masks in files of other programs: each form gives the masks that were written."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from PIL import Image

from physic_core import InputError
from physic_core.io.mask_file import read_masks
from physic_core.types import FileOfPhoto

HEIGHT, WIDTH = 40, 60
RECTANGLE = [10, 5, 30, 5, 30, 25, 10, 25]


@pytest.fixture
def masks():
    """Two masks without overlap, one of them with a hole."""
    found = np.zeros((2, HEIGHT, WIDTH), bool)
    found[0, 5:25, 10:30] = True
    found[0, 10:15, 15:20] = False
    found[1, 8:30, 35:50] = True
    return found


def read(path, size=(WIDTH, HEIGHT)):
    return read_masks(FileOfPhoto(path, "photo.jpg", size))


def run_lengths(mask):
    """Numbers of pixels by column, zeros first."""
    flat = mask.T.ravel()
    ends = np.flatnonzero(np.diff(flat)) + 1
    return np.diff([0, *ends, len(flat)]).tolist() if not flat[0] else None


def as_text(counts):
    """COCO's text of run lengths."""
    text = ""
    for i, count in enumerate(counts):
        x = count - (counts[i - 2] if i > 2 else 0)
        more = True
        while more:
            part = x & 31
            x >>= 5
            more = x != -1 if part & 16 else x != 0
            text += chr(48 + (part | (32 if more else 0)))
    return text


def annotation(mask, form, **others):
    counts = run_lengths(mask)
    counts = as_text(counts) if form == "text" else counts
    segmentation = {"size": [HEIGHT, WIDTH], "counts": counts}
    return {"image_id": 7, "category_id": 1, "segmentation": segmentation} | others


@pytest.mark.parametrize("form", ["list", "text"])
def test_run_lengths_of_coco(tmp_path, masks, form):
    path = tmp_path / "coco_instances_results.json"
    dog = annotation(masks[0], form, category_id=18)
    entries = [annotation(mask, form, score=0.9) for mask in masks]
    path.write_text(json.dumps([*entries, dog]))
    found = read(path)
    np.testing.assert_array_equal(found.masks, masks)
    assert found.notes


def test_polygons_of_coco_of_the_photo_alone(tmp_path):
    path = tmp_path / "instances.json"
    one = {"image_id": 2, "category_id": 5, "segmentation": [RECTANGLE]}
    other = one | {"image_id": 1, "segmentation": [[0, 0, 9, 0, 9, 9]]}
    images = [
        {"id": i, "file_name": name, "width": WIDTH, "height": HEIGHT}
        for i, name in ((1, "other.jpg"), (2, "photo.jpg"))
    ]
    categories = [{"id": 5, "name": "person"}]
    document = {"images": images, "annotations": [other, one], "categories": categories}
    path.write_text(json.dumps(document))
    (mask,) = read(path).masks
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[5:25, 10:30] = True
    assert (mask ^ expected).sum() <= 45  # a rim of half a pixel


@pytest.mark.parametrize("largest", [1, 255, 2])
def test_labels_of_a_picture(tmp_path, masks, largest):
    """SAM 2 writes 0 and 1 for one object, and numbers in a palette for several."""
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[masks[0]] = 1 if largest == 2 else largest
    labels[masks[1]] = 2 if largest == 2 else 0
    picture = Image.fromarray(labels)
    if largest == 2:
        picture = picture.convert("P")
        picture.putdata(labels.ravel().tolist())
    picture.save(tmp_path / "a.png")
    found = read(tmp_path / "a.png").masks
    np.testing.assert_array_equal(found, masks if largest == 2 else masks[:1])


def test_the_border_of_data_sets_is_nobody(tmp_path, masks):
    labels = masks[0] + 2 * masks[1] * ~masks[0]
    border = np.where(labels == 0, 255, labels).astype(np.uint8)
    Image.fromarray(border).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read(tmp_path / "a.png").masks, [labels == 1, labels == 2])


def test_arrays(tmp_path, masks):
    np.savez(tmp_path / "a.npz", masks=masks)
    np.testing.assert_array_equal(read(tmp_path / "a.npz").masks, masks)


def test_masks_of_half_the_size_are_enlarged(tmp_path, masks):
    np.savez(tmp_path / "a.npz", masks=masks)
    found = read(tmp_path / "a.npz", (2 * WIDTH, 2 * HEIGHT)).masks
    np.testing.assert_array_equal(found[:, ::2, ::2], masks)


def test_automatic_masks_of_sam_are_of_all_things(tmp_path, masks):
    for i, mask in enumerate(masks):
        cv2.imwrite(str(tmp_path / f"{i}.png"), 255 * mask.astype(np.uint8))
    np.testing.assert_array_equal(read(tmp_path).masks, masks)
    (tmp_path / "metadata.csv").write_text("id,area\n")
    assert not read(tmp_path).are_people
    entries = [annotation(mask, "text", predicted_iou=0.9) for mask in masks]
    (tmp_path / "list.json").write_text(json.dumps(entries))
    found = read(tmp_path / "list.json")
    assert not found.are_people
    np.testing.assert_array_equal(found.masks, masks)


@pytest.mark.parametrize("end", ["", " 0.9", " 0.9 3"])
def test_polygons_of_ultralytics(tmp_path, end):
    shares = np.reshape(RECTANGLE, (-1, 2)) / [WIDTH, HEIGHT]
    points = " ".join(f"{value:.6f}" for value in shares.ravel())
    (tmp_path / "photo.txt").write_text(f"16 {points}{end}\n0 {points}{end}\n")
    (mask,) = read(tmp_path / "photo.txt").masks
    assert abs(int(mask.sum()) - 20 * 20) <= 45


WRONG = {
    "nothing": (np.zeros((1, HEIGHT, WIDTH), bool), "no mask"),
    "another shape": (np.ones((1, HEIGHT, HEIGHT), bool), "photo has 60 x 40"),
    "one dimension": (np.ones(5), "no array"),
    "inverted": (np.ones((2, HEIGHT, WIDTH), bool), "inverted"),
    "words": (np.full((1, HEIGHT, WIDTH), "a"), "of numbers"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_arrays_are_named(tmp_path, name):
    values, word = WRONG[name]
    np.savez(tmp_path / "a.npz", masks=values)
    with pytest.raises(InputError, match=word):
        read(tmp_path / "a.npz")


ONE = annotation(np.zeros((HEIGHT, WIDTH), bool), "list")
WRONG_TEXTS = {
    "px of the picture": ("a.txt", "0 300 200 100 200 100 300\n", "polygon"),
    "another size": ("a.json", [annotation(np.zeros((4, 4), bool), "list")], "px"),
    "no size": ("a.json", [ONE | {"segmentation": {"counts": [9]}}], "lacks 'size'"),
    "a point": ("a.json", [ONE | {"segmentation": [[3, 4]]}], "1 points"),
    "no JSON": ("a.json", None, "format is unknown"),
}


@pytest.mark.parametrize("name", WRONG_TEXTS)
def test_wrong_texts_are_named(tmp_path, name):
    file, content, word = WRONG_TEXTS[name]
    is_text = isinstance(content, str)
    (tmp_path / file).write_text(content if is_text else json.dumps(content) if content else "")
    with pytest.raises(InputError, match=word):
        read(tmp_path / file)


def test_a_picture_of_colors_is_named(tmp_path):
    Image.new("RGB", (WIDTH, HEIGHT), "red").save(tmp_path / "a.png")
    with pytest.raises(InputError, match="colors"):
        read(tmp_path / "a.png")


@pytest.mark.parametrize(
    "segmentation",
    [
        [[5, 5, 2**63, 5, 30, 25]],
        {"size": [10**6, 10**6], "counts": [10**12]},
        {"size": [HEIGHT, WIDTH], "counts": [1.5, HEIGHT * WIDTH - 1.5]},
        {"size": [0, WIDTH], "counts": []},
    ],
)
def test_segmentations_of_no_picture_are_refused(tmp_path, segmentation):
    path = tmp_path / "masks.json"
    path.write_text(json.dumps([{"category_id": 1, "segmentation": segmentation}]))
    with pytest.raises(InputError):
        read(path)


@pytest.mark.parametrize("side", [0, 10**9, "60"])
def test_a_picture_has_two_sides(tmp_path, side):
    path = tmp_path / "masks.json"
    images = [{"id": 1, "width": WIDTH, "height": side}]
    annotations = [{"image_id": 1, "segmentation": [RECTANGLE]}]
    path.write_text(json.dumps({"images": images, "annotations": annotations}))
    with pytest.raises(InputError):
        read(path)


def test_masks_without_a_pixel_are_counted(tmp_path):
    path = tmp_path / "masks.json"
    path.write_text(json.dumps([{"segmentation": [RECTANGLE]}, {"segmentation": []}]))
    found = read(path)
    assert len(found.masks) == 1
    assert any(note.startswith("left out 1 given masks") for note in found.notes)
