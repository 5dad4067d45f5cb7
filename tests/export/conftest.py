"""One reconstruction of a mock world with two people who sit side by side, saved, for all exports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from physic_core import Reconstruction, load_config, reconstruct
from physic_core.visual.export.write import Exported, export_reconstruction
from physic_testing.worlds import build_world


@pytest.fixture(scope="session")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a result; three steps of optimisation are enough for files."""
    world = build_world("sit_side_by_side", 0, (160, 120))
    overrides = ["run.cache=false", "engine.joint.optimiser.steps=3"]
    folder = tmp_path_factory.mktemp("saved") / "out"
    reconstruct(world.image, load_config(preset="mock", overrides=overrides)).save(str(folder), preview=False)
    return folder


@pytest.fixture(scope="session")
def result(saved: Path) -> Reconstruction:
    return Reconstruction.load(str(saved))


@pytest.fixture
def export(result: Reconstruction, tmp_path: Path) -> Callable[..., Exported]:
    """Export the result, or another one, to a file name in a new folder."""

    def write(name: str, format: str | None = None, *, of: Reconstruction = result, **options: object) -> Exported:
        return export_reconstruction(of, tmp_path / name, format, **options)  # type: ignore[arg-type]

    return write
