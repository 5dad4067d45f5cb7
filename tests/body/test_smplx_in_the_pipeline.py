"""A whole run on a made-up SMPL-X file: bodies come as embedded ones, and who builds on bodies gets
the file's.
"""

from __future__ import annotations

import numpy as np
import pytest
from other_body import posed, smplx_file_arrays

from physic_core import load_config, reconstruct
from physic_core.body.convert.bodies import convert_with_residuals, replace_mesh_with_joints
from physic_core.types import Bodies
from physic_testing.worlds import load_world


@pytest.fixture(scope="module")
def file(other, tmp_path_factory):
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz"
    np.savez(path, **smplx_file_arrays(other))
    yield path
    path.unlink()  # pytest keeps folders of old runs


@pytest.fixture(scope="module")
def world():
    return load_world("stand_indoors", (160, 120))


def run(world, *overrides):
    return reconstruct(
        world.image, load_config(preset="mock", overrides=["run.cache=false", *overrides])
    )


RULER = (
    "metric_depth={backend='embedded', options={}}",
    "contact_prior={backend='embedded', options={}}",
)


def test_scale_and_contact_work_with_a_smplx_body(world, file, maps):
    plain = run(world, *RULER)
    result = run(world, f"body_model.path={file}", *RULER)
    assert result.body_model == "smplx"
    assert result.warnings == plain.warnings
    assert any(
        note.startswith("bodies converted from 'embedded' to 'smplx'") for note in result.notes
    )
    assert "contact transferred from the mesh 'physic-embedded-1' to 'smplx'" in result.notes
    ratio = np.nanmedian(result.scene.points[..., 2] / plain.scene.points[..., 2])
    assert ratio == pytest.approx(1, abs=0.02)
    assert result.people[0].contact.mean() > 0.5 * plain.people[0].contact.mean()


def test_a_body_converted_by_its_joints_has_the_same_height(embedded, other_model, maps):
    """As the ruler takes it: from the embedded body to the file's, and back by joints that lie
    elsewhere.
    """
    world = load_world("stand_indoors", (160, 120))
    bodies_of_world = Bodies(world.parameters, "embedded")
    there = convert_with_residuals(bodies_of_world, other_model).bodies
    back = convert_with_residuals(replace_mesh_with_joints(there, other_model), embedded).bodies
    sole = embedded.contact_sets["left_sole"]
    feet = [
        posed(embedded, bodies.parameters)[0][0, sole, 1].max()
        for bodies in (bodies_of_world, back)
    ]
    assert feet[1] == pytest.approx(feet[0], abs=0.01)
