"""Mocks in place of networks: without a fault, or with one of the wrapper."""

from __future__ import annotations

import inspect
import zlib
from dataclasses import replace

import numpy as np

from physic_core.errors import BackendError
from physic_core.interfaces.comparison import named_values
from physic_core.types import TOUCH_PARTS, mirrored_order
from physic_mock import backends as mocks
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks
from physic_testing.conformance.tables import TABLES

SIZE = (160, 120)
"""Of photos on which faults show in networks without other errors, px."""

NO_NOISE = {
    "MockMetricDepth": {"noise": 0, "stated_sigma": 0.1},
    "MockRelativePointmap": {"noise": 0, "unknown": "scale"},
}
"""Mock -> its options; all others have {"noise": 0}."""

_ANSWERS = {}


def answer_of(kind, mock, arguments):
    """The mock's answer, each of which is computed once."""
    values = (value for _, value in named_values(arguments))
    parts = [v.tobytes() if isinstance(v, np.ndarray) else repr(v).encode() for v in values]
    key = (kind, mock.options.model_dump_json(), zlib.crc32(b"".join(parts)))
    if key not in _ANSWERS:
        _ANSWERS[key] = kind.infer(mock, *arguments)
    return _ANSWERS[key]


def mirrored_points(ask, image, hints):
    pointmap = ask(image, hints)
    side = np.float32([-1, 1, 1])
    return replace(
        pointmap,
        points=pointmap.points[:, ::-1] * side,
        valid=pointmap.valid[:, ::-1],
        up=pointmap.up * side,
    )


def mirrored_people(ask, image, people, keypoints, intrinsics):
    observations = ask(image, replace(people, masks=people.masks[..., ::-1]), keypoints, intrinsics)
    return replace(
        observations,
        touch=observations.touch[:, mirrored_order(TOUCH_PARTS)],
        head=observations.head * [-1, 1, 1],
    )


MIRRORED = {"MockRelativePointmap": mirrored_points, "MockPersonObserver": mirrored_people}
"""Mock -> its answer for a mirrored photo, by what it answers for the photo."""


def stand_in(mock, change=None):
    """A mock whose answer goes through ``change(answer, *arguments)``."""
    kind = getattr(mocks, mock)

    def infer(self, image, *rest):
        def ask(*arguments):
            return answer_of(kind, self, arguments)

        try:
            answer = ask(image, *rest)
        except BackendError:
            if mock not in MIRRORED:
                raise
            answer = MIRRORED[mock](ask, np.ascontiguousarray(image[:, ::-1]), *rest)
        return answer if change is None else change(answer, image, *rest)

    infer.__signature__ = inspect.signature(kind.infer)
    return type(mock, (kind,), {"infer": infer})


def subject_of(kind, *, noise=0, seed=0, size=SIZE):
    """A stand-in under test."""
    options = NO_NOISE.get(kind.__name__, {"noise": 0})
    if noise:
        options = {"noise": noise, "noise_seed": seed}
    subject = find_backend(kind, None, options=options, size=size)
    subject.table = TABLES[kind.interface]
    return subject


def checks_of(mock, change=None, **settings):
    """All checks of a mock whose answer is changed."""
    return start_checks(subject_of(stand_in(mock, change), **settings))


class RightDepth(stand_in("MockMetricDepth")):
    """Has to be loaded before it is asked."""

    loaded = False

    def load(self, device="cpu"):
        self.loaded = True

    def close(self):
        self.loaded = False

    def infer(self, image, hints):
        if not self.loaded:
            raise BackendError("not loaded: call load() first")
        return super().infer(image, hints)
