"""What a backend does to its process decides neither what ``physic`` does nor what it prints."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

import hostile
from physic_batch.workers import WorkerSettings, run_in_workers
from physic_core.configuration.resolve import ResolvedBackend
from physic_core.errors import BackendOutputError
from physic_core.interfaces import MetricDepth, MetricDepthRequest
from physic_core.pipeline.stage_caller import StageCaller
from physic_core.types import DepthMap, Hints, Provenance


class Own(MetricDepth):
    """Calls a function with its input, and returns depths of 1 m."""

    def __init__(self, deed):
        super().__init__()
        self.deed = deed
        self.depth = np.ones((6, 8), np.float32)

    def infer(self, image, hints):
        self.deed(image)
        return DepthMap(self.depth)


def call(deed, image=None):
    return run(Own(deed), image)


def give(depth):
    backend = Own(lambda image: None)
    backend.depth = depth
    return run(backend)


def run(backend, image=None):
    resolved = ResolvedBackend(
        backend, Provenance("metric_depth", "own", "p", "my-dist", "1.0", {}, "")
    )
    request = MetricDepthRequest(np.zeros((6, 8, 3), np.uint8) if image is None else image, Hints())
    return StageCaller("cpu", 1).call_backend("depth", resolved, request), backend


def test_input_and_output_are_copies():
    image = np.zeros((6, 8, 3), np.uint8)
    result, backend = call(lambda given: given.fill(255), image)
    assert not image.any()
    backend.depth[:] = np.nan
    assert (result.depth == 1).all()


ONES = np.ones((6, 8))


def unaligned(values):
    place = np.zeros(values.nbytes + 1, np.uint8)[1:].view(values.dtype).reshape(values.shape)
    place[:] = values
    return place


@pytest.mark.parametrize(
    "depth",
    [
        *(ONES.astype(kind) for kind in ("f2", "f4", ">f8")),
        *(
            np.asfortranarray(ONES),
            ONES[::-1, ::-1],
            ONES.repeat(2, 1)[:, ::2],
            np.broadcast_to(1.0, (6, 8)),
        ),
        unaligned(ONES),
    ],
    ids=lambda depth: f"{depth.dtype.str} {depth.strides}",
)
def test_an_array_of_floats_is_taken_however_it_lies_in_memory(depth):
    found, _ = give(depth)
    assert (found.depth == 1).all()
    torch.from_numpy(found.depth)


@pytest.mark.parametrize(
    ("depth", "name"),
    [
        (ONES.astype(complex), "complex128"),
        (ONES.astype(int), "int64"),
        (ONES.astype(object), "object"),
        (np.zeros((6, 8), "f4,f4"), "'f0'"),
        (np.ma.array(ONES), "MaskedArray"),
        (ONES[None], "got (1, 6, 8)"),
        (torch.ones(6, 8), "Tensor"),
        pytest.param(
            ONES.astype(np.longdouble),
            np.dtype(np.longdouble).name,
            marks=pytest.mark.skipif(
                np.dtype(np.longdouble).itemsize == 8, reason="needs wider floats"
            ),
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_no_array_of_floats_is_refused_by_name(depth, name):
    with pytest.raises(BackendOutputError) as error:
        give(depth)
    assert name in str(error.value)
    assert "metric_depth 'own' (my-dist 1.0)" in str(error.value)


# ---- calls that hang
# -------------------------------------------------------------------------------------------------


def test_a_worker_that_hangs_is_ended_and_the_others_go_on():
    outcomes = list(
        run_in_workers(hostile.HANGS, hostile.open_worker, WorkerSettings(2, timeout=1.0))
    )
    assert [outcome.failure for outcome in outcomes] == ["Timeout"] * len(hostile.HANGS)
    assert {outcome.message for outcome in outcomes} == {
        "no result, and no work for 1 s; --timeout sets the limit, and --retry failed tries the "
        "photo again"
    }


@pytest.mark.parametrize(
    ("name", "state", "message"),
    [("Printing", "ok", ""), ("Forging", "broken", "it ended Python with code 0: physic-doctor: ")],
)
def test_doctor_prints_what_it_found_itself(name, state, message, physic):
    done = physic("plugins", "doctor", f"hostile:{name}", "--json")
    [found] = json.loads(done.stdout)
    assert found["state"] == state
    assert found["message"].startswith(message)
    assert done.exit_code == (0 if state == "ok" else 5)
