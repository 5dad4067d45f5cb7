"""One backend alone: load_backend, options as keyword arguments, checked calls."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from PIL import Image
from pydantic import Field

from physic_core import (
    BackendOutputError,
    ConfigError,
    InputError,
    WeightsMissingError,
    load_backend,
)
from physic_core.interfaces import INTERFACES, ContactPrior, MetricDepth, Options
from physic_core.io.photo import read_photo
from physic_core.types import DepthMap, Hints, Intrinsics, People
from physic_testing.worlds import load_world


class FlatOptions(Options):
    metres: float = Field(2.0, gt=0, description="Depth of all pixels.")


class Flat(MetricDepth):
    Options: ClassVar[type[Options]] = FlatOptions

    def infer(self, image, hints):
        return DepthMap(np.full(image.shape[:2], self.options.metres))


class Behind(Flat):
    def infer(self, image, hints):
        return DepthMap(np.full(image.shape[:2], -1.0))


class Forgetful(Flat):
    def __init__(self, options=None):
        self.network = None


IMAGE = np.zeros((64, 80, 3), np.uint8)
NOBODY = People(np.zeros((0, 64, 80), bool), np.zeros((0, 4), np.float32), np.zeros(0, np.float32))


def test_options_are_keyword_arguments():
    assert Flat().options == FlatOptions()
    three = FlatOptions(metres=3.0)
    assert Flat(metres=3.0).options == Flat(three).options == Flat(options=three).options == three
    with pytest.raises(ConfigError, match="Flat: no option 'meters'; there are: metres"):
        Flat(meters=3.0)
    with pytest.raises(ConfigError, match=r"Flat: metres: .*greater than 0 \(got -1\.0\)"):
        Flat(metres=-1.0)
    with pytest.raises(ConfigError, match="not as both"):
        Flat(FlatOptions(), metres=3.0)
    with pytest.raises(TypeError, match=r"Forgetful.*: call super\(\).__init__\(options\)"):
        Forgetful()


def test_a_backend_is_called_with_an_array_and_its_result_is_checked():
    assert (Flat(metres=3.0)(IMAGE).depth == 3).all()
    assert (Flat()(IMAGE, Hints(hole=np.zeros((64, 80), bool))).depth == 2).all()
    with pytest.raises(BackendOutputError, match="depth must be > 0 m or NaN"):
        Behind()(IMAGE)
    with pytest.raises(InputError, match=r"got \(64, 80\) uint8"):
        Flat()(IMAGE[..., 0])
    with pytest.raises(InputError, match=r"keyword argument 'hint'$"):
        Flat()(IMAGE, hint=None)
    with pytest.raises(InputError, match=r"missing 1 required .* 'mask'$"):
        load_backend("inpainter", "telea")(IMAGE)


def test_each_interface_can_be_called_alone():
    world = load_world("stand", (160, 120))
    found = {}

    def ask(name, *arguments):
        found[name] = load_backend(name, "mock")(world.image, *arguments)
        return found[name]

    people = ask("segmenter")
    keypoints = ask("keypoint_detector", people)
    bodies = ask("body_estimator", people, world.intrinsics, keypoints)
    ask("hand_estimator", people, keypoints)
    ask("person_observer", people, keypoints, world.intrinsics)
    ask("contact_prior", people, bodies)
    ask("inpainter", people.masks.any(0))
    ask("metric_depth", Hints(scene=ask("relative_pointmap", Hints())))
    assert found.keys() == INTERFACES.keys()
    assert len(bodies.parameters) == 1
    assert found["metric_depth"].depth.shape == (120, 160)


def test_a_backend_that_cannot_be_loaded():
    for arguments, options, message in (
        (("depth", "mock"), {}, r"no interface named 'depth'; there are: segmenter, .*"),
        (
            ("inpainter", "none-such"),
            {},
            r"inpainter\.backend: no inpainter named 'none-such'; installed: .*",
        ),
        (
            ("inpainter", "telea"),
            {"radius": 3},
            r"options\.radius: unknown option\. Did you mean 'radius_px'\?",
        ),
        (("inpainter", ""), {}, r"load_backend: name a backend of inpainter, one of .*telea.*"),
    ):
        with pytest.raises(ConfigError, match=message):
            load_backend(*arguments, **options)
    with pytest.raises(WeightsMissingError, match="moge-2-onnx"):
        load_backend("metric_depth", "moge-2-onnx")


@pytest.mark.parametrize("shape", [(64, 80), (64, 80, 1), (64, 80, 4)])
def test_grey_and_rgba_arrays_are_converted_as_pil_images(shape):
    array = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    given = read_photo(array)
    image = read_photo(Image.fromarray(array.squeeze()))
    assert np.array_equal(given.image, image.image)
    assert (given.notes, given.digest) == (image.notes, image.digest)


class ReadsTheCamera(Flat):
    """Reads one of its hints."""

    reads = ("intrinsics",)

    def infer(self, image, hints):
        assert hints.people is None
        assert hints.hole is None
        return DepthMap(np.full(image.shape[:2], 1.0), hints.intrinsics)


def test_a_backend_gets_the_hints_that_it_declares_and_no_others():
    camera = Intrinsics.from_focal(100.0, 80, 64)
    found = ReadsTheCamera()(IMAGE, Hints(camera, NOBODY, hole=np.ones((64, 80), bool)))
    assert found.intrinsics == camera


def test_using_an_argument_that_is_not_declared_is_an_error():
    class Prior(ContactPrior):
        reads = ("people",)

        def infer(self, image, people, bodies):
            return bodies.parameters

    with pytest.raises(AttributeError, match="lacks 'bodies', whose 'parameters'"):
        Prior()(IMAGE, NOBODY, None)


def test_a_class_that_reads_something_unknown_is_refused():
    with pytest.raises(TypeError, match="no argument or hint is named camera"):
        type("Wrong", (Flat,), {"reads": ("camera",)})
