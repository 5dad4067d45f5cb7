from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from physic_core import types
from physic_core.types import (
    BodyParameters,
    DepthMap,
    Intrinsics,
    People,
    Person,
    Plane,
    Pointmap,
    Reconstruction,
    Scene,
)
from physic_core.types.short_repr import ShortRepr

SCREEN = 24 * 80
HEIGHT, WIDTH, VERTICES = 480, 640, 10475
CAMERA = Intrinsics.from_focal(500, WIDTH, HEIGHT)


def image(*channels: int, dtype: str = "float32") -> np.ndarray:
    return np.zeros((HEIGHT, WIDTH, *channels), dtype)


def parameters(people: int) -> BodyParameters:
    widths = (3, 63, 45, 45, 3, 3, 3, 10, 0, 3)
    return BodyParameters(*(np.zeros((people, width), np.float32) for width in widths))


def person() -> Person:
    points = np.zeros((VERTICES, 3), np.float32)
    return Person(
        np.array([1.0, 2.5, 100, 200]), 0.98765, image(dtype="bool"), np.zeros((133, 2)), np.zeros(133),
        parameters(1), points, points[:55], points[:, 0] > 0, points[:, 0],
    )  # fmt: skip


def scene(floor: Plane | None = None, sigma: float | None = None) -> Scene:
    points = image(3)
    return Scene(points, points, image(3, dtype="uint8"), image(dtype="bool"), floor, points[0], 1.0, sigma)


def result(people: int, found: Scene, **further: object) -> Reconstruction:
    faces = np.zeros((20908, 3), np.int32)
    everybody = (person(),) * people
    return Reconstruction(image(3, dtype="uint8"), CAMERA, found, everybody, faces, "embedded", "coco17", **further)  # type: ignore[arg-type]


def test_the_repr_of_a_reconstruction_is_one_line():
    floor = Plane(np.array([0, -1.0, 0]), 1.5)
    assert repr(result(2, scene(floor, 0.08), warnings=("no scale",))) == (
        "Reconstruction(2 people, 640 x 480, floor found, scale ±8 %, 1 warning)"
    )
    assert repr(result(1, scene(floor))) == (
        "Reconstruction(1 person, 640 x 480, floor found, scale of unknown error, no warnings)"
    )
    assert "0 people, 640 x 480, no floor" in repr(result(0, scene()))


def test_arrays_are_their_type_and_shape_and_few_numbers_themselves():
    assert repr(DepthMap(image(), CAMERA, 0.123456, ("a", "b"))) == (
        f"DepthMap(depth=float32 (480, 640), intrinsics={CAMERA!r}, scale_sigma=0.1235, notes=<2 x str>)"
    )
    assert repr(Plane(np.array([0, -1.0, 0]), 1.5)) == "Plane(normal=[0, -1, 0], offset=1.5)"
    assert repr(person()).startswith(
        "Person(box=[1, 2.5, 100, 200], score=0.9877, mask=bool (480, 640), keypoints=float64 (133, 2), "
    )

    @dataclasses.dataclass(frozen=True)
    class OfTensors(ShortRepr):
        points: torch.Tensor
        few: torch.Tensor

    cloud = OfTensors(torch.zeros(7, 3), torch.tensor([1.0], requires_grad=True))
    assert repr(cloud).endswith("OfTensors(points=float32 (7, 3), few=[1])")


@pytest.mark.parametrize(
    "held",
    [
        person(),
        scene(),
        parameters(40),
        People(image(dtype="bool")[None], np.zeros((1, 4)), np.ones(1)),
        Pointmap(image(3), image(dtype="bool"), "scale", CAMERA),
        result(8, scene()),
    ],
    ids=lambda held: type(held).__name__,
)
def test_what_holds_arrays_fits_on_a_screen(held: object):
    assert len(repr(held)) < SCREEN


def test_every_dataclass_of_arrays_that_plugins_meet_is_short():
    for name in types.__all__:
        kind = getattr(types, name)
        if dataclasses.is_dataclass(kind):
            hints = " ".join(str(field.type) for field in dataclasses.fields(kind))
            assert "Array" not in hints or issubclass(kind, ShortRepr), name
