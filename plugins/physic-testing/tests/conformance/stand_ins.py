"""Mocks in place of networks, with a fault of the wrapper."""

from __future__ import annotations

import inspect
import zlib

import numpy as np

from physic_core.interfaces.comparison import named_values
from physic_mock import backends as mocks
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks

NO_NOISE = {
    "MockMetricDepth": {"noise": 0, "stated_sigma": 0.1},
    "MockRelativePointmap": {"noise": 0, "unknown": "scale"},
}
"""Mock -> its options; all others have {"noise": 0}."""

_ANSWERS = {}


def answer_of(kind, own, arguments):
    """The mock's answer, each of which is computed once."""
    values = (value for _, value in named_values(arguments))
    parts = [v.tobytes() if isinstance(v, np.ndarray) else repr(v).encode() for v in values]
    key = (kind, own.options.model_dump_json(), zlib.crc32(b"".join(parts)))
    if key not in _ANSWERS:
        _ANSWERS[key] = kind.infer(own, *arguments)
    return _ANSWERS[key]


def run_checks(mock, change=None, *, noise=0, seed=0):
    """All checks of a mock whose result is changed by ``change(result, *arguments)``."""
    kind = getattr(mocks, mock)

    def infer(self, *arguments):
        answer = answer_of(kind, self, arguments)
        return answer if change is None else change(answer, *arguments)

    infer.__signature__ = inspect.signature(kind.infer)
    options = {"noise": noise, "noise_seed": seed} if noise else NO_NOISE.get(mock, {"noise": 0})
    return start_checks(find_backend(type(mock, (kind,), {"infer": infer}), None, options=options))
