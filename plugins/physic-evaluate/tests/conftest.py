"""Model files made from the embedded body."""

from __future__ import annotations

import numpy as np
import pytest

from physic_evaluate.bodies import BodyFiles

from .miniatures import Files, other_body


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Files of the size and layout of SMPLX_{NEUTRAL,MALE}.npz and SMPL_NEUTRAL.pkl; male is larger than neutral."""
    from physic_core.body import load_body
    from physic_testing.body_files import write_published

    made, embedded = other_body(), load_body("embedded")
    folder = tmp_path_factory.mktemp("models")
    (folder / "smplx").mkdir()
    (folder / "smpl").mkdir()
    arrays = made.smplx_file_arrays(made.make(embedded, 10475))
    rng = np.random.default_rng(0)
    for side in "lr":
        arrays[f"hands_mean{side}"] = 0.1 * np.ones(45)
        arrays[f"hands_components{side}"] = np.linalg.qr(rng.standard_normal((45, 45)))[0]
    np.savez(folder / "smplx" / "SMPLX_NEUTRAL.npz", **arrays)
    np.savez(folder / "smplx" / "SMPLX_MALE.npz", **arrays | {"v_template": 1.05 * arrays["v_template"]})
    smpl = made.make(embedded, 6890)
    write_published(folder / "smpl" / "SMPL_NEUTRAL.pkl", made.smpl_file_arrays(smpl))
    return Files(BodyFiles(folder / "smplx", folder / "smpl"))
