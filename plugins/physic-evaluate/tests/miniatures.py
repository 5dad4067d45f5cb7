"""A person of a world as truth, model files made from the embedded body, and miniatures of results."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from click.testing import CliRunner, Result

from physic_core.cli import main
from physic_evaluate.bodies import BodyFiles, PosedBody

ROOT = Path(__file__).parents[3]
K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
SIZE = (640, 480)
STANDING = {"global_orient": [np.pi, 0, 0], "transl": [0.1, 0.35, 3.5]}
"""Upright before an OpenCV camera, facing it."""


def other_body() -> ModuleType:
    """The module of the core's tests that makes bodies of SMPL-X's and SMPL's kind from the embedded one."""
    if "other_body" not in sys.modules:
        spec = importlib.util.spec_from_file_location("other_body", ROOT / "tests" / "body" / "other_body.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules["other_body"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["other_body"])
    return sys.modules["other_body"]


@dataclass(frozen=True)
class Files:
    """Model files, and their bodies posed."""

    bodies: BodyFiles

    def standing(self, **parameters: Any) -> PosedBody:
        return self.bodies.smplx_body(STANDING | parameters, "male")

    def arguments(self) -> list[str]:
        return ["--smplx", str(self.bodies.smplx), "--smpl", str(self.bodies.smpl)]


def run(*arguments: str) -> Result:
    """Run ``physic evaluate`` with these arguments."""
    return CliRunner().invoke(main, ["evaluate", *arguments])


def write_plain(folder: Path, name: str, **arrays: Any) -> None:
    """Write a result of the plain reader."""
    path = folder / f"{name}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)


def figures(out: Path, method: str) -> dict[str, float]:
    """Column -> value of a method in results.json."""
    import json

    document = json.loads((out / "results.json").read_text())
    return {key: found["value"] for key, found in document["figures"][method].items() if found["count"]}
