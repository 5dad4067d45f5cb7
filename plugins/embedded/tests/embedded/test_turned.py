"""People who are not upright are looked at again in turned squares, and others are not."""

from __future__ import annotations

import numpy as np
import pytest

from physic_embedded.networks.crops import ImagePyramid
from physic_embedded.networks.sessions import open_packaged_session
from physic_embedded.segmentation.people import pose_in_box


@pytest.fixture(scope="module")
def landmarker():
    return open_packaged_session("pose_landmark_heavy", 1)


def turned_by(points, quarters, height, width):
    """Where points (N, 2) of a picture are after turns by quarters, counterclockwise."""
    x, y = points.T
    return np.stack([[x, y], [y, width - 1 - x], [width - 1 - x, height - 1 - y]][quarters], 1)


@pytest.mark.parametrize("quarters", [1, 2])
def test_a_person_is_found_as_well_in_a_photo_that_is_turned(landmarker, people, image, quarters):
    height, width = image.shape[:2]
    box = people.boxes[0]
    pose = pose_in_box(landmarker, ImagePyramid.from_image(image), box)
    corners = turned_by(box.reshape(2, 2), quarters, height, width)
    around = np.concatenate([corners.min(0), corners.max(0)])
    picture = ImagePyramid.from_image(np.ascontiguousarray(np.rot90(image, quarters)))
    found = pose_in_box(landmarker, picture, around)
    off = found.points[11:29] - turned_by(pose.points[11:29], quarters, height, width)
    assert np.linalg.norm(off, axis=1).max() < 0.03 * np.ptp(pose.points, axis=0).max()
