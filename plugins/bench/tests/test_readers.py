"""Pickles and other files of data sets: read as numbers, or refused with their name."""

from __future__ import annotations

import os
import pickle

import numpy as np
import pytest
import torch

from physic_bench.data_files import (
    DamagedFrameError,
    open_picture,
    read_json,
    read_mesh,
    read_npz,
    read_pickled,
)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (pickle.dumps({"K": torch.eye(3)}), "torch._utils._rebuild_tensor_v2"),
        (pickle.dumps({"K": np.eye(30)})[:3000], "cannot be read"),
    ],
)
def test_torch_tensors_and_cut_off_pickles_are_refused(content, reason, tmp_path):
    (tmp_path / "a.pkl").write_bytes(content)
    with pytest.raises(DamagedFrameError, match=reason):
        read_pickled(tmp_path / "a.pkl")


@pytest.mark.parametrize(
    "read",
    [read_npz, read_pickled, read_json, read_mesh, lambda path: open_picture(path).__enter__()],
)
@pytest.mark.parametrize(
    "make",
    [lambda path: None, os.mkfifo, lambda path: path.write_bytes(b"\x00\xff[{")],
    ids=["missing", "pipe", "garbage"],
)
def test_a_file_that_cannot_be_read_is_named_without_waiting(read, make, tmp_path):
    file = tmp_path / "a.ply"
    make(file)
    with pytest.raises(DamagedFrameError, match=file.name):
        read(file)


@pytest.mark.parametrize(
    "change",
    [{"betas": np.full(10, np.nan)}, {"body_pose": np.zeros(62)}, {"transl": "far"}],
    ids=str,
)
def test_parameters_that_are_no_body_are_refused(change, files):
    with pytest.raises(DamagedFrameError, match=next(iter(change))):
        files.bodies.pose_smplx(change)
