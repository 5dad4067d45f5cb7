"""A photo without people: the scene alone, with the scale that the metric depth knows, or with a
guessed one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import load_reconstruction
from physic_core.errors import BackendError, NoPersonError
from physic_core.types import FOUND_TWICE, UnposedPerson
from physic_mock import backends
from tests.pipeline.mocks import changed, run

pytestmark = pytest.mark.usefixtures("few_steps")

MOCK = ("metric_depth.options.noise=0", "relative_pointmap.options.noise=0")


class NeedsPeople(backends.MockMetricDepth):
    def infer(self, image, hints):
        raise NoPersonError("this depth needs people")


class Broken(backends.MockMetricDepth):
    def infer(self, image, hints):
        raise MemoryError


def test_the_scene_is_metric_if_the_metric_depth_needs_no_people(world, tmp_path):
    result = run(world.empty_image, *MOCK)
    assert result.people == ()
    assert result.scene.floor.offset == pytest.approx(world.floor.offset, abs=0.02)
    assert np.array_equal(result.scene.colors, result.image)
    assert any(
        note.startswith("no person was found: the result is only the scene")
        for note in result.notes
    )
    measured = {check.name: check.value for check in result.checks}
    assert measured["photo_alignment"] is None
    # No inpainting and no second point map: nothing is removed from the photo.
    backend_stages = [stage.name for stage in result.stages if stage.provenance is not None]
    assert backend_stages == ["people", "scene point map", "metric depth"]
    result.save(str(tmp_path / "out"))
    again = load_reconstruction(tmp_path / "out")
    assert again.people == ()
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "combined.glb", "preview.png", "reconstruction.json", "reconstruction.npz"
    }  # fmt: skip


def test_a_metric_depth_that_needs_people_leaves_the_scale_unknown(world):
    needs_people = {"metric_depth": NeedsPeople}
    result = run(world.empty_image, *MOCK, backends=needs_people)
    assert result.scene.scale_sigma is None
    assert result.scene.floor.offset == pytest.approx(1.45, abs=0.02)
    assert any(
        "the camera is assumed to be 1.45 m above the floor" in warning
        for warning in result.warnings
    )
    height = "photo.camera_height=2.0"
    measured = run(world.empty_image, *MOCK, height, backends=needs_people)
    assert measured.scene.floor.offset == pytest.approx(2.0, abs=0.001)
    assert not any("the scale is unknown" in warning for warning in measured.warnings)
    with pytest.raises(BackendError, match="MemoryError"):
        run(world.empty_image, backends={"metric_depth": Broken})


def with_boxes(found, image):
    """The people of the mock, and more boxes without a pose, whose pixels are the top left
    corner.
    """
    corner = np.zeros(image.shape[:2], bool)
    corner[:20, :30] = True
    return replace(found, unposed=BOXES, unposed_mask=corner)


BOXES = tuple(
    UnposedPerson((0.0, 0.0, 30.0, 20.0), 0.6, reason)
    for reason in ("no pose fits the box", FOUND_TWICE, "more than 1 person: give 2", FOUND_TWICE)
)


def test_a_box_without_a_body_is_reported_and_not_left_in_the_scene(world, tmp_path):
    holes = []

    def look(picture, _, mask):
        holes.append(mask)
        return picture

    given = changed(backends.MockSegmenter, with_boxes) | changed(backends.MockInpainter, look)
    result = run(world.image, backends=given)
    assert holes[0][:20, :30].all()
    assert len(result.people) == len(world.masks)
    assert result.unposed == BOXES
    assert ", 2 without a body, " in repr(result)
    assert result.summary()["unposed"] == 2
    assert any("1 no pose fits the box, 1 more than 1 person" in note for note in result.notes)
    result.save(str(tmp_path / "out"))
    assert load_reconstruction(tmp_path / "out").unposed == result.unposed
