"""A whole run on a made-up SMPL-X file: bodies come as embedded ones, and who builds on bodies gets
the file's.
"""

from __future__ import annotations

import numpy as np
import pytest
from other_body import smplx_file_arrays

from physic_core import load_config, reconstruct
from physic_testing.worlds import load_world


@pytest.fixture(scope="module")
def file(other, tmp_path_factory):
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz"
    np.savez(path, **smplx_file_arrays(other))
    yield path
    path.unlink()  # pytest keeps folders of old runs


def run(*overrides):
    ruler = (f"{stage}={{backend='embedded', options={{}}}}" for stage in EMBEDDED)
    config = load_config(preset="mock", overrides=["run.cache=false", *ruler, *overrides])
    return reconstruct(load_world("stand_indoors", (160, 120)).image, config)


EMBEDDED = ("metric_depth", "contact_prior")


def test_scale_and_contact_work_with_a_smplx_body(file, maps):
    plain = run()
    result = run(f"body_model.path={file}")
    assert result.body_model == "smplx"
    assert result.warnings == plain.warnings
    assert any(
        note.startswith("bodies converted from 'embedded' to 'smplx'") for note in result.notes
    )
    assert "contact transferred from the mesh 'physic-embedded-1' to 'smplx'" in result.notes
    ratio = np.nanmedian(result.scene.points[..., 2] / plain.scene.points[..., 2])
    assert ratio == pytest.approx(1, abs=0.02)
    assert result.people[0].contact.mean() > 0.5 * plain.people[0].contact.mean()
