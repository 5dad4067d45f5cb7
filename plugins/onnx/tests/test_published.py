"""The published weights of SAM 2 tiny, as they are: docs/estimators.md says how to get them."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from physic_core import load_backend
from physic_core.weights import missing
from physic_onnx.sam2 import Sam2, Sam2Options
from physic_onnx.sam2_networks import open_sam2
from physic_onnx.sessions import OnnxOptions
from physic_testing import load_world

from .pose_worlds import KnownBoxes

PHOTO = Path(__file__).parents[3] / "examples" / "basketball.png"


def needs(name):
    lack = missing(Sam2.manifest(), name)
    return [pytest.mark.published, pytest.mark.skipif(bool(lack), reason="; ".join(lack))]


@pytest.fixture(scope="module")
def networks():
    from physic_core.weights import locate

    return open_sam2(locate(Sam2.manifest(), "sam2-hiera-tiny"), OnnxOptions(), "cpu")


@pytest.fixture
def sam2(networks):
    backend = Sam2(Sam2Options())
    backend._network = networks, KnownBoxes()
    return backend


class TestSam2:
    pytestmark = needs("sam2-hiera-tiny")

    @pytest.mark.parametrize("name", ["stand", "group", "sit_on_chair"])
    def test_people_of_worlds_are_segmented(self, sam2, name):
        world = load_world(name, (320, 240))
        sam2.network[1].boxes = world.boxes
        people = sam2.infer(world.image)
        union = people.masks.any(0) | world.masks.any(0)
        assert (people.masks.any(0) & world.masks.any(0)).sum() / union.sum() > 0.75

    def test_boxes_are_passed_in_the_frame_of_the_training(self, networks):
        """The network itself tells how well a mask fits, and does not believe a box that is off."""
        world = load_world("stand", (320, 240))
        right = networks.masks_from_boxes(networks.encode(world.image), world.boxes)[1].max()
        away = networks.masks_from_boxes(networks.encode(world.image), world.boxes + 60)[1].max()
        assert right > 0.8
        assert right > away + 0.05


class TestFromPhotoToFiles:
    """SAM 2 with the people of the embedded segmenter: all weights are of package registries."""

    pytestmark = needs("sam2-hiera-tiny")

    def test_the_masks_are_those_of_sam_2_and_the_rest_is_kept(self):
        photo = cv2.cvtColor(cv2.imread(str(PHOTO.with_name("couple.jpg"))), cv2.COLOR_BGR2RGB)
        names = (
            {"name": "embedded"},
            {"name": "sam2-onnx"},
        )
        embedded, sam = (
            load_backend("segmenter", options.pop("name"), **options)(photo) for options in names
        )
        assert len(embedded) == len(sam) == 2
        both = (embedded.masks & sam.masks).sum((1, 2))
        either = (embedded.masks | sam.masks).sum((1, 2))
        assert ((both / either > 0.8) & (both < either)).all()
        assert sam.keypoints.joint_set.name == embedded.keypoints.joint_set.name
        assert sam.surfaces is not None
        assert not (sam.floor & sam.masks.any(0)).any()


def test_the_embedded_detector_needs_its_plugin(monkeypatch):
    backend = Sam2(Sam2Options())
    assert not any("embedded" in text for text in backend.missing())
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-onnx")
    assert any("metricbody-embedded" in text for text in backend.missing())
