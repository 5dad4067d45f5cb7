"""A Pipeline that stays loaded: what it takes, how often backends are loaded, and what its errors
name.
"""

from __future__ import annotations

import re
import threading
from collections import Counter
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from PIL import Image

from physic_core import (
    BackendError,
    ConfigError,
    InputError,
    NoPersonError,
    PhysicError,
    Pipeline,
    load_config,
    reconstruct,
)
from physic_core.interfaces import MetricDepth
from physic_core.io.photo import read_photo
from physic_core.types import SUMMARY_COLUMNS, DepthMap
from physic_mock import backends
from tests.pipeline.mocks import changed, without_people

pytestmark = pytest.mark.usefixtures("few_steps")


@pytest.fixture(autouse=True)
def passed_the_kit(monkeypatch):
    """Backends that are not asked twice."""
    monkeypatch.setattr("physic_core.pipeline.stage_caller.has_passed_kit", lambda *_: True)


class CountedDepth(backends.MockMetricDepth):
    events: ClassVar[Counter[str]] = Counter()

    def load(self, device="cpu"):
        self.events["load"] += 1
        super().load(device)

    def infer(self, image, hints):
        self.events["infer"] += 1
        return super().infer(image, hints)

    def close(self):
        self.events["close"] += 1
        super().close()


@pytest.fixture(autouse=True)
def events(monkeypatch):
    monkeypatch.setattr(CountedDepth, "events", Counter())
    return CountedDepth.events


@pytest.fixture(scope="module")
def result(world):
    return reconstruct(world.image, "mock")


@pytest.fixture(scope="module")
def photo(world, tmp_path_factory):
    path = tmp_path_factory.mktemp("photo") / "stand.png"
    Image.fromarray(world.image).save(path)
    return path


def same(one, other):
    return np.array_equal(one.people[0].vertices, other.people[0].vertices) and np.array_equal(
        one.scene.points, other.scene.points
    )


def test_backends_are_loaded_once_and_closed_at_the_end(world, result, events):
    with Pipeline("mock", backends={"metric_depth": CountedDepth}) as pipeline:
        assert events == Counter()
        pipeline.warm_up()
        assert events == {"load": 1}
        first = pipeline(world.image)
        second = pipeline(world.image)
        assert events == {"load": 1, "infer": 2}
    assert events == {"load": 1, "infer": 2, "close": 1}
    assert same(first, result)
    assert same(second, result)
    with pytest.raises(PhysicError, match=r"^the pipeline is closed: create a new one$"):
        pipeline(world.image)


def test_a_load_that_failed_is_tried_again(world, events):
    class Late(CountedDepth):
        def load(self, device="cpu"):
            super().load(device)
            if self.events["load"] == 1:
                raise RuntimeError("the disk is not mounted")

    with Pipeline("mock", backends={"metric_depth": Late}) as pipeline:
        with pytest.raises(BackendError, match="RuntimeError: the disk is not mounted"):
            pipeline.warm_up()
        assert len(pipeline(world.image).people) == 1
    assert events == {"load": 2, "infer": 1, "close": 2}


def test_every_kind_of_photo_gives_the_same_result(photo, world, result):
    given = [photo, str(photo), photo.read_bytes(), Image.open(photo), world.image]
    photos = [read_photo(one) for one in given]
    assert all(np.array_equal(one.image, world.image) for one in photos)
    path, text, content, pil, array = (one.digest for one in photos)
    assert path == text == content != pil == array
    found = reconstruct(photo, "mock")
    assert same(found, result)
    assert (found.photo, found.photo_name, result.photo_name) == (path, photo.name, "")


def test_an_error_names_the_photo(photo):
    blind = changed(backends.MockSegmenter, without_people)
    config = {"extends": "mock", "photo": {"require_people": True}}
    with Pipeline(config, backends=blind) as pipeline, Image.open(photo) as image:
        for one in (photo, image):
            with pytest.raises(NoPersonError) as error:
                pipeline(one)
            assert str(error.value).startswith(
                f"{photo}: no person was found in the photo of 160 x 120 px by "
            )


def test_settings_of_one_photo_hold_for_that_photo_only(world):
    with Pipeline(
        {"extends": "mock", "photo": {"intrinsics": [400.0, 400.0, 160.0, 120.0]}}
    ) as pipeline:
        found = pipeline(world.image, settings={"focal_px": 300.0})
        assert (found.intrinsics.fx, found.config["photo"]["focal_px"]) == (300.0, 300.0)
        assert "intrinsics" not in found.config["photo"]
        assert pipeline.config.photo.focal_px is None
        with pytest.raises(ConfigError) as error:
            pipeline(world.image, settings={"focal": 300.0})
    assert str(error.value).startswith("settings of this photo: photo.focal: unknown key")


class Flat(MetricDepth):
    """Depth of an instance with an attribute that no option knows."""

    def __init__(self, depth_m):
        super().__init__()
        self.depth_m = depth_m

    def infer(self, image, hints):
        return DepthMap(np.full(image.shape[:2], self.depth_m, np.float32))


def test_an_instance_replaces_the_configs_choice_and_is_not_cached(world, tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSIC_CACHE", str(tmp_path))
    # others weigh it beside the people
    own_scale = load_config(preset="mock", overrides=["engine.preset=paper"])
    depths = [
        reconstruct(world.image, own_scale, backends={"metric_depth": Flat(z)}) for z in (2.0, 4.0)
    ]
    near, far = (
        float(np.median(found.scene.points[..., 2]) / found.scene.scale) for found in depths
    )
    assert far == pytest.approx(2 * near, rel=0.05)
    who = next(s.provenance for s in depths[0].stages if s.name == "metric depth")
    assert (who.backend, who.distribution) == (f"{__name__}:Flat", "given in Python")
    assert depths[0].config["metric_depth"]["backend"] == f"{__name__}:Flat"


@pytest.mark.parametrize(
    ("given", "kind", "message"),
    [
        (
            {"metric_dept": Flat(1.0)},
            ConfigError,
            "no interface named 'metric_dept'; there are: segmenter",
        ),
        ({"inpainter": Flat}, BackendError, "backends['inpainter']: "),
        ({"inpainter": "telea"}, BackendError, "backends['inpainter']: "),
    ],
    ids=["interface", "class", "name"],
)
def test_a_given_backend_of_the_wrong_kind(given, kind, message):
    with pytest.raises(kind, match=re.escape(message)):
        Pipeline("mock", backends=given)


@pytest.mark.parametrize(
    ("name", "value"),
    [("intrinsics", (300, 300, 160, 120)), ("people", ((5, 5),)), ("known", {"stature": 1.8})],
)
def test_what_is_given_of_another_type_is_refused_by_name(world, name, value):
    with Pipeline("mock") as pipeline, pytest.raises(ConfigError, match=f"{name} must be"):
        pipeline(world.image, **{name: value})


@pytest.mark.parametrize("name", ["depth", "pointmap", "keypoints"])
def test_a_missing_file_of_a_photo_is_an_unusable_input(world, name):
    with (
        Pipeline("mock") as pipeline,
        pytest.raises(InputError, match=r"nowhere\.npy: there is no"),
    ):
        pipeline(world.image, settings={name: "nowhere.npy"})


def test_a_second_thread_is_refused(world):
    refused = []

    def second():
        try:
            pipeline(world.image)
        except PhysicError as error:
            refused.append(str(error))

    def meanwhile(picture, *_):
        thread = threading.Thread(target=second)
        thread.start()
        thread.join()
        return picture

    with Pipeline("mock", backends=changed(backends.MockInpainter, meanwhile)) as pipeline:
        pipeline(world.image)
    assert refused == ["the pipeline is running in another thread: create one per thread"]


def test_a_person_is_a_mesh_and_the_scene_a_cloud_of_points(result):
    person = result.people[0]
    mesh = person.mesh()
    assert np.array_equal(mesh.faces, result.faces)
    assert np.array_equal(mesh.vertex_attributes["contact"], person.contact)
    # m³ of a grown person; negative if faces point inwards
    assert mesh.volume == pytest.approx(0.07, abs=0.03)
    cloud = result.scene_points()
    assert np.array_equal(cloud.colors[:, :3], result.scene.colors[result.scene.valid])
    with pytest.raises(InputError, match=r"^this person has no faces: take it from the people of"):
        replace(person, faces=None).mesh()


def test_a_summary_is_flat_numbers(result):
    numbers = result.summary()
    assert list(numbers)[: len(SUMMARY_COLUMNS)] == list(SUMMARY_COLUMNS)
    assert numbers["usable_place"] == result.usable["place"]
    assert all(value is None or type(value) in (int, float) for value in numbers.values())
    (person,) = result.people
    assert numbers["nearest_person_m"] == pytest.approx(np.linalg.norm(person.joints[0]))
    assert numbers["vertices_in_contact"] == person.contact.sum()
    likely = [contact for contact in person.contacts if contact.likely]
    assert numbers["contacts"] == len(likely) > 0
    assert {f"check_{check.name}" for check in result.checks} < numbers.keys()
