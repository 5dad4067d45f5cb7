"""Equal contents have equal digests, and other contents have others."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from physic_core.cache.digests import Digester
from physic_core.types import Hints, Intrinsics, Keypoints, Plane

pytestmark = pytest.mark.quick


def digest(*things):
    return Digester().digest(*things)


def keypoints(seed=0):
    rng = np.random.default_rng(seed)
    return Keypoints(rng.normal(size=(2, 17, 2)), rng.random((2, 17)), "coco17")


def test_equal_contents_have_one_digest_wherever_they_lie():
    whole = np.arange(24.0).reshape(4, 6)
    assert (
        digest(whole[:, ::2])
        == digest(whole[:, ::2].copy())
        == digest(np.asfortranarray(whole[:, ::2]))
    )
    assert digest(Hints(keypoints=keypoints())) == digest(Hints(keypoints=keypoints()))
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    assert digest((1, "a")) == digest([1, "a"])


THINGS = [
    None, True, 1, 1.0, "1", "None", "", (), ((),), (1, 2), ((1,), 2), ("12",), ("1", "2"), {},
    {"a": 1}, float("nan"), np.float32(1), np.zeros(2), np.zeros((2, 1)), np.zeros((1, 2)),
    np.zeros(2, np.float32), np.zeros(16, np.uint8), np.zeros(0), np.zeros((0, 4)), np.array(0.0),
    -np.zeros(2), np.zeros(2, ">f8"), keypoints(), keypoints(1),
    replace(keypoints(), skeleton="coco23"), Hints(keypoints=keypoints()), Hints(),
    Plane(np.zeros(3), 1.0), Intrinsics(1, 1, 1, 1, 2, 2), Intrinsics(1, 1, 1, 1, 2, 2, "EXIF"),
]  # fmt: skip


def test_no_two_of_many_things_have_one_digest():
    pairs = combinations([(digest(thing), thing) for thing in THINGS], 2)
    assert [(a, b) for (one, a), (other, b) in pairs if one == other] == []


@pytest.mark.parametrize(
    ("thing", "message"),
    [
        ({1, 2}, "set has no digest."),
        (np.array([{}], object), "an array of Python objects has no digest."),
        (Hints(hole=object()), "object has no digest."),
    ],
)
def test_digest_refuses_objects_without_contents(thing, message):
    with pytest.raises(TypeError) as error:
        digest(thing)
    assert str(error.value) == message
