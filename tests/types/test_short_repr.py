from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import torch

from physic_core import types
from physic_core.types import DepthMap, Intrinsics, Plane
from physic_core.types.short_repr import ShortRepr


def test_the_repr_of_a_reconstruction_is_one_line_and_a_picture_in_notebooks(reconstruction, make):
    assert (
        repr(reconstruction)
        == "Reconstruction(2 people, 160 x 120, floor detected, scale ±7 %, 2 warnings)"
    )
    assert reconstruction._repr_html_().startswith('<img src="data:image/')
    empty = replace(make(people=0), scene=replace(reconstruction.scene, floor=None))
    assert "0 people, 160 x 120, no floor" in repr(empty)


def test_arrays_are_their_type_and_shape_and_few_numbers_themselves():
    camera = Intrinsics.from_focal(500, 640, 480)
    assert repr(DepthMap(np.zeros((480, 640), np.float32), camera, 0.123456, ("a", "b"))) == (
        f"DepthMap(depth=float32 (480, 640), intrinsics={camera!r}, scale_sigma=0.1235, notes=<2 "
        f"x str>)"
    )
    assert repr(Plane(np.array([0, -1.0, 0]), 1.5)) == "Plane(normal=[0, -1, 0], offset=1.5)"

    @dataclasses.dataclass(frozen=True)
    class OfTensors(ShortRepr):
        points: torch.Tensor
        few: torch.Tensor

    cloud = OfTensors(torch.zeros(7, 3), torch.tensor([1.0], requires_grad=True))
    assert repr(cloud).endswith("OfTensors(points=float32 (7, 3), few=[1])")


def test_every_dataclass_of_arrays_that_plugins_meet_is_short():
    for name in types.__all__:
        kind = getattr(types, name)
        if dataclasses.is_dataclass(kind):
            hints = " ".join(str(field.type) for field in dataclasses.fields(kind))
            assert "Array" not in hints or issubclass(kind, ShortRepr), name
