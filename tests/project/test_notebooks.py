"""The notebooks of the documentation: their code runs, on worlds of the mocks, and their outputs are small."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

from physic_core.configuration import model as config

pytestmark = pytest.mark.usefixtures("few_steps")

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted(ROOT.glob("docs/notebooks/*.ipynb"))


def cells(path: Path, kind: str) -> list[dict[str, Any]]:
    found = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]
    return [cell | {"source": "".join(cell["source"])} for cell in found]


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run a cell, and return the value of its last line if that is an expression, as a notebook shows it."""
    tree = ast.parse(source)
    last = tree.body[-1]
    if not isinstance(last, ast.Expr):
        exec(compile(tree, "cell", "exec"), names)
        return None
    exec(compile(ast.Module(tree.body[:-1], []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_code_of_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from PIL import Image

    from physic_testing import build_world

    folder = tmp_path / "docs" / "notebooks"
    folder.mkdir(parents=True)
    (tmp_path / "examples").mkdir()
    Image.fromarray(build_world("stand", 0, (160, 120)).image).save(tmp_path / "examples" / "couple.jpg", "PNG")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(config, "DEFAULT_PRESET", "mock")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in cells(path, "code"):
        shown = run_cell(cell["source"], names)
        if hasattr(shown, "_repr_html_"):
            assert "<img" in shown._repr_html_()
