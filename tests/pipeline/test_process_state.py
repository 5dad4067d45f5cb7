"""A backend cannot change results of others by settings of the process: they are restored, and the
backend is named.
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


def change_all():
    torch.set_default_dtype(torch.float64)
    torch.set_default_device("meta")
    torch.set_grad_enabled(False)
    np.seterr(all="raise")
    os.chdir("/")


def state():
    of_torch = torch.get_default_dtype(), torch.get_default_device(), torch.is_grad_enabled()
    return of_torch, np.geterr(), Path.cwd()


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
    warnings = [text for text in run(Naughty(where, change_all, error)).warnings if "->" in text]
    assert state() == before
    assert all(text.startswith("metric_depth 'naughty' (my-dist 1.0)") for text in warnings)
    changes = ("folder", "float32 -> torch.float64", "cpu -> meta", "True -> False", "-> {'divide'")
    for what, text in zip(changes, warnings, strict=True):
        assert what in text
