"""Run the notebooks of the documentation and keep their outputs: ``python tools/run_notebooks.py [NAME...]``.

Pictures are made smaller, and what differs from run to run is removed.
"""

from __future__ import annotations

import base64
import io
import re
import sys
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "notebooks"
WIDTH, COLORS = 900, 128


def smaller(png: bytes) -> str:
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.thumbnail((WIDTH, WIDTH), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    picture.quantize(COLORS, dither=Image.Dither.NONE).save(buffer, "PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


def tidy(output: Any) -> None:
    output.get("metadata", {}).clear()
    data = output.get("data", {})
    if shown := re.search(r"data:image/png;base64,([\w+/=]+)", data.get("text/html", "")):
        data["image/png"] = smaller(base64.b64decode(shown[1]))
        del data["text/html"]
    elif "image/png" in data:
        data["image/png"] = smaller(base64.b64decode(data["image/png"]))
        data.pop("image/jpeg", None)


def run(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(FOLDER)}}).execute()
    for cell in notebook.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":
            # A stream of errors is a progress or a warning of this machine.
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
            for output in cell.outputs:
                tidy(output)
    notebook.metadata["language_info"] = {"name": "python"}
    nbformat.write(notebook, path)
    print(path.name, path.stat().st_size // 1024, "KB")


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(file.stem for file in FOLDER.glob("*.ipynb")):
        run(FOLDER / f"{name}.ipynb")
