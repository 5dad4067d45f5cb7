from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_core.interfaces import Segmenter
from physic_core.types import SurfaceLabels, UnposedPerson, mirrored_order
from physic_embedded.networks.crops import ImagePyramid, RotatedSquare
from physic_embedded.networks.mobile_sam import ImageEmbedding, embed_image, predict_masks
from physic_embedded.networks.pose import Pose, average_agreeing
from physic_embedded.networks.pose_detection import DETECTOR_LAYERS, detect_people
from physic_embedded.networks.sessions import open_packaged_session
from physic_embedded.networks.single_shot_detection import anchor_centers, decode_detections
from physic_embedded.networks.tiles import tiles
from physic_embedded.segmentation.floor_mask import add_labelled_floor
from physic_embedded.segmentation.hidden_people import grey_out
from physic_embedded.segmentation.people import LOW, is_person
from physic_embedded.segmentation.person_masks import resolve_overlaps
from physic_embedded.segmentation.unposed import count_heads
from physic_testing import violations


def pose_at(center, height=200.0, confidence=1.0):
    """A stick figure: shoulders, hips and feet about a middle."""
    at = np.zeros((33, 2))  # in heights, about the middle
    at[0, 1] = -0.45
    for left, down, half in ((11, -0.3, 0.1), (23, 0.0, 0.07), (25, 0.25, 0.06), (27, 0.45, 0.05)):
        at[[left, left + 1]] = [[half, down], [-half, down]]
    at[[29, 31, 30, 32]] = at[[27, 27, 28, 28]] + [0, 0.05]
    return Pose(
        points=at * height + center,
        visibility=np.full(33, confidence),
        presence=np.ones(33),
        world=np.zeros((33, 3)),
        world_spread=np.zeros(33),
        score=1.0,
        mask=np.ones((256, 256)),
        square=RotatedSquare(np.array(center, float), 1.25 * height, 0.0),
        mirror_gap=0.0,
        mirror_mask_iou=1.0,
    )


@pytest.mark.parametrize(
    ("box", "score", "heads"),
    [
        ((110, 60, 170, 250), 0.8, 2),  # the other
        ((110, 60, 170, 250), 0.45, 1),
        ((50, 50, 110, 150), 0.8, 1),  # the upper half
        ((50, 150, 170, 250), 0.8, 1),  # the legs of both
        ((160, 60, 220, 250), 0.8, 1),  # beside the mask
    ],
)
def test_a_box_whose_top_is_another_head_in_the_mask_is_counted(box, score, heads):
    mask = np.zeros((1, 300, 300), bool)
    mask[0, 50:250, 50:110] = mask[0, 60:250, 110:170] = True
    pose = pose_at((80, 150))
    pose.points[:11] = pose.points[0]
    boxes = [UnposedPerson(box, score, "no pose")]
    assert count_heads(boxes, [pose], mask).tolist() == [heads]
    assert count_heads(boxes, [], mask[:0]).tolist() == []


@given(st.integers(1, 900), st.integers(1, 900), st.floats(0.2, 0.9))
def test_tiles_cover_the_photo_and_stay_on_it(width, height, fraction):
    covered = np.zeros((height, width), bool)
    found = list(tiles(width, height, [fraction]))
    for x, y, side in found:
        assert 0 <= x <= max(0, width - side)
        assert 0 <= y <= max(0, height - side)
        covered[y : y + side, x : x + side] = True
    assert covered.all() or fraction * max(width, height) < 160


def embedding_of(height, width):
    features = np.zeros((1, 256, 64, 64), np.float32)
    return ImageEmbedding(features, height, width, 1024 / max(height, width))


def test_the_mask_of_an_ellipse_is_that_ellipse():
    red = (190, 40, 30)
    image = np.full((300, 400, 3), 200, np.uint8)
    cv2.ellipse(image, (170, 160), (90, 50), 25, 0, 360, red, -1)
    truth = (image == red).all(-1)
    embedding = embed_image(open_packaged_session("mobilesam_encoder", 1), image)
    answer = predict_masks(
        open_packaged_session("mobilesam_decoder", 1),
        embedding,
        np.array([[170, 160.0]]),
        np.zeros((0, 2)),
    )
    masks = [embedding.to_photo(v) > 0 for v in answer.logits]
    assert max((m & truth).sum() / (m | truth).sum() for m in masks) > 0.96


def test_overlapping_masks_are_separated_and_a_stray_piece_is_given_back():
    logits = np.full((2, 256, 256), -5.0)
    logits[0, 50:200, 20:140] = 2.0
    logits[0, 100:110, 200:210] = 3.0
    logits[1, 50:200, 100:230] = 1.0
    inside = np.array([[[60.0, 100.0]], [[180.0, 100.0]]])
    left, right = resolve_overlaps([*zip(logits, inside, strict=True)], embedding_of(256, 256))
    wanted = np.zeros((256, 256), bool)
    wanted[50:200, 20:140] = True
    np.testing.assert_array_equal(left, wanted)
    assert not (left & right).any()
    assert right[105, 205]


@pytest.mark.slow
def test_people_are_found_all_along_a_panorama(segmenter, image):
    mirrored = image[:, ::-1]
    strip = np.concatenate([mirrored, image, mirrored], axis=1)
    found = segmenter.infer(cv2.resize(strip, (768, 192), interpolation=cv2.INTER_AREA))
    middles = found.boxes[:, [0, 2]].mean(1)
    men = 256 * np.arange(3) + [212, 44, 212]  # the man who is seen whole
    for man in men:
        assert np.abs(middles - man).min() < 30


def test_the_example_photo_has_two_count_people(people, image):
    assert violations(Segmenter, people, height=image.shape[0], width=image.shape[1]) == []
    assert len(people) == 2
    assert (np.diff(people.scores) <= 0).all()
    assert people.boxes[0, 2] < 200 < 400 < people.boxes[1, 0]


def test_world_joints_have_the_frame_of_the_camera(people):
    face_on, from_behind = people.keypoints.world
    assert np.abs(face_on[[23, 24]].mean(axis=0)).max() < 0.02
    # Down is positive: nose over hips over ankles. The first man shows his face, the second the
    # back of his head.
    assert face_on[0, 1] < -0.4 < 0.4 < face_on[27, 1]
    assert face_on[0, 2] < face_on[[7, 8], 2].mean()
    assert from_behind[0, 2] > from_behind[[7, 8], 2].mean()


def test_a_mirror_image_swaps_sides(segmenter, people, image):
    other = segmenter.infer(np.ascontiguousarray(image[:, ::-1]))
    assert len(other) == 2
    swap = mirrored_order(people.keypoints.joint_set.names)
    back = other.keypoints.points[0, swap] * [-1, 1] + [image.shape[1] - 1, 0]
    apart = np.linalg.norm(back - people.keypoints.points[0], axis=1)
    assert apart.mean() < 4
    assert (other.masks[0, :, ::-1] & people.masks[0]).sum() > 0.95 * people.masks[0].sum()


def test_people_too_low_for_a_mask_are_reported_without_a_pose(segmenter, pytestconfig):
    bgr = cv2.imread(str(pytestconfig.rootpath / "examples" / "couple.jpg"))
    photo = np.full((200, 260, 3), 128, np.uint8)
    photo[60:88, 80:122] = cv2.resize(bgr, (42, 28), interpolation=cv2.INTER_AREA)[..., ::-1]
    found = segmenter.infer(photo)
    assert len(found) == 0
    assert [one.reason for one in found.unposed if one.is_missing] == [LOW, LOW]


@pytest.mark.parametrize("shape", [(8, 8), (8, 300), (64, 64), (240, 320)])
def test_no_people_are_found_in_an_empty_photo(segmenter, shape):
    noise = np.random.default_rng(0).integers(0, 255, (*shape, 3), np.uint8)
    found = segmenter.infer(noise)
    assert violations(Segmenter, found, height=shape[0], width=shape[1]) == []
    assert len(found) == 0
    assert not found.floor.any()


def rectangle(rows, columns=slice(None)):
    mask = np.zeros((100, 100), bool)
    mask[rows, columns] = True
    return mask


def test_labels_extend_the_floor_beside_the_feet_where_they_touch_it():
    person = rectangle(slice(20, 70), slice(40, 50))
    labelled = rectangle(slice(60, 100))
    nothing = np.zeros_like(person)
    near = rectangle(slice(65, 80), slice(30, 60)) & ~person
    step = rectangle(slice(40, 50), slice(30, 60)) & ~person
    apart = labelled | rectangle(slice(0, 5))
    speck = rectangle(slice(99, 100))
    for floor, label, people, wanted in (
        (near, labelled, person, labelled & ~person),
        (step, labelled, person, step),
        (near, apart, person, labelled & ~person),
        (nothing, labelled, nothing, labelled),
        (nothing, labelled, person, nothing),
        (near, speck, person, near),
    ):
        surfaces = SurfaceLabels(label.astype(np.uint8), ("unknown", "floor"))
        np.testing.assert_array_equal(add_labelled_floor(floor, surfaces, people), wanted)


def test_boxes_lie_at_their_anchors_and_those_that_overlap_are_averaged_by_their_scores():
    anchors = anchor_centers(224, DETECTOR_LAYERS)
    raw = np.zeros((len(anchors), 6))
    logits = np.full(len(anchors), -100.0)
    chances = np.array([0.8, 0.6, 0.7])
    rows = [2, 4, 60]  # the centres (12, 4), (20, 4) and (20, 12) px
    logits[rows] = np.log(chances / (1 - chances))
    raw[rows] = [4, -2, 40, 20, 10, 30], [6, -2, 40, 20, 2, 30], [0, 90, 40, 20, 0, 0]
    first, second = decode_detections(raw, logits, anchors, 224, threshold=0.5)
    left = 16 + 10 * 0.6 / 1.4
    np.testing.assert_allclose(first.box, [left - 20, -8, left + 20, 12])
    np.testing.assert_allclose(first.keypoints, [[22, 34]])
    np.testing.assert_allclose(second.box, [0, 92, 40, 112])


def test_joints_that_poses_agree_about_are_averaged_and_others_are_kept():
    """The side of the square is 250 px: the left wrist moves by 4 px and the right one by 40 px."""
    pose, other = pose_at((100, 100)), pose_at((100, 100))
    other.points[[15, 16], 0] += [4.0, 40.0]
    mean = average_agreeing(pose, [pose, other], near=0.02)
    np.testing.assert_allclose(
        mean.points - pose.points, np.eye(33)[15][:, None] * [2.0, 0.0], atol=1e-9
    )


def test_a_player_beside_the_middle_is_one_candidate(image):
    session = open_packaged_session("pose_detection", threads=1)
    beside = cv2.copyMakeBorder(image, 0, 0, 0, image.shape[1] // 2, cv2.BORDER_CONSTANT)
    found = [
        len(detect_people(session, ImagePyramid.from_image(photo), 0.5, 0.9, ()))
        for photo in (beside, beside[:, ::-1])
    ]
    assert found == [1, 1]


def test_somebody_small_is_a_candidate_in_the_square_around_a_box(pytestconfig):
    session = open_packaged_session("pose_detection", threads=1)
    photo = cv2.imread(str(pytestconfig.rootpath / "examples" / "slope.jpg"))[..., ::-1]
    small = cv2.resize(photo, None, fx=0.1, fy=0.1, interpolation=cv2.INTER_AREA)
    height, width = small.shape[:2]
    far = np.full((10 * height, 10 * width, 3), 114, np.uint8)
    far[height : 2 * height, 9 * width :] = small
    box = np.array([9 * width, height, 10 * width, 2 * height], float)
    picture = ImagePyramid.from_image(far)
    assert detect_people(session, picture, 0.5, 0.5, ()) == []
    (skier,) = detect_people(session, picture, 0.5, 0.5, (), people_boxes=[box])
    np.testing.assert_allclose(skier.keypoints[0], [696, 201], atol=4)


@pytest.mark.parametrize(
    ("detected", "gap", "overlap", "person"),
    [(0.8, 0.1, 0.5, True), (0.5, 0.1, 1.0, False), (0.5, 0.0, 0.5, False), (0.5, 0.0, 1.0, True)],
)
def test_a_weak_candidate_must_look_the_same_in_the_mirror(detected, gap, overlap, person):
    pose = replace(pose_at((100, 100)), mirror_gap=gap, mirror_mask_iou=overlap)
    assert is_person(pose, detected, 0.75) == person


def test_people_are_covered_in_grey_and_nothing_else_is():
    image = np.full((200, 200, 3), 10, np.uint8)
    covered = grey_out(image, [pose_at((60, 100), height=80)])
    assert (covered[55:145, 15:105] == 114).all()
    assert (covered[:, 115:] == 10).all()
    assert (image == 10).all()
