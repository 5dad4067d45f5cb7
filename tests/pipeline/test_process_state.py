"""A backend cannot change results of others by the working folder or torch's default dtype: both
are restored, and the backend is named.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import torch

from physic_core.configuration.resolve import ResolvedBackend
from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, MetricDepthRequest
from physic_core.pipeline.stage_caller import StageCaller
from physic_core.types import DepthMap, Hints, Provenance

SHAPE = (6, 8)


def change_both():
    torch.set_default_dtype(torch.float64)
    os.chdir("/")


def state():
    return torch.get_default_dtype(), Path.cwd()


class Naughty(MetricDepth):
    """Does something in one of its methods, and returns depths of 1 m."""

    def __init__(self, where, do, error=None):
        super().__init__()
        self.where = where
        self.do = do
        self.error = error

    def load(self, device="cpu"):
        self.act("load")

    def infer(self, image, hints):
        self.act("infer")
        return DepthMap(np.ones(SHAPE, np.float32))

    def close(self):
        self.act("close")

    def act(self, where):
        if where == self.where:
            self.do()
            if self.error is not None:
                raise self.error


def run(backend):
    stages = StageCaller("cpu", 1)
    who = ResolvedBackend(
        backend, Provenance("metric_depth", "naughty", "p", "my-dist", "1.0", {}, "")
    )
    try:
        stages.call_backend(
            "depth", who, MetricDepthRequest(np.zeros((*SHAPE, 3), np.uint8), Hints())
        )
    except BackendError:
        assert backend.error is not None
    stages.close()
    return stages


@pytest.mark.parametrize("error", [None, ValueError("no")])
@pytest.mark.parametrize("where", ["load", "infer", "close"])
def test_what_a_backend_changes_is_restored_and_named(where, error):
    before = state()
    warnings = [text for text in run(Naughty(where, change_both, error)).warnings if "->" in text]
    assert state() == before
    assert all(text.startswith("metric_depth 'naughty' (my-dist 1.0)") for text in warnings)
    for what, text in zip(("current folder", "float32 -> torch.float64"), warnings, strict=True):
        assert what in text
