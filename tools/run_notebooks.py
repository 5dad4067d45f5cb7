"""Run the notebooks of the documentation and keep their outputs: ``python tools/run_notebooks.py
[--check] [NAME...]``.

Pictures are made smaller, and what differs from run to run is removed. ``--check`` keeps nothing:
it compares what is printed with the outputs that were kept.
"""

from __future__ import annotations

import argparse
import base64
import io
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import docs_numbers
import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "notebooks"
WIDTH = 900
COLORS = 128


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


def execute(path: Path) -> Any:
    """Return the notebook with the outputs of the code at hand."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=600, coalesce_streams=True, resources={"metadata": {"path": str(FOLDER)}}
    ).execute()
    for cell in notebook.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":
            # A stream of errors is a progress or a warning of this machine.
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
            for output in cell.outputs:
                tidy(output)
    notebook.metadata["language_info"] = {"name": "python"}
    return notebook


def printed(notebook: Any) -> str:
    """Return all that the cells of a notebook print."""
    outputs = [one for cell in notebook.cells if cell.cell_type == "code" for one in cell.outputs]
    return "".join(one["text"] for one in outputs if one["output_type"] == "stream")


def run_all(check: bool, names: list[str] | None = None) -> list[str]:
    """Run notebooks.

    Keep their outputs, or with ``check`` return in which lines the kept ones are wrong.
    """
    wrong = []
    # empty, so that all is of the code at hand; notebooks share photos
    with tempfile.TemporaryDirectory() as cache:
        os.environ["PHYSIC_CACHE"] = cache
        for name in names or sorted(file.stem for file in FOLDER.glob("*.ipynb")):
            path = FOLDER / f"{name}.ipynb"
            notebook = execute(path)
            if check:
                differences = docs_numbers.text_differences(
                    printed(nbformat.read(path, as_version=4)), printed(notebook)
                )
                wrong += [f"{path.name}: {line}" for line in differences]
                print(path.name, "differs" if differences else "agrees", flush=True)
            else:
                nbformat.write(notebook, path)
                print(path.name, path.stat().st_size // 1024, "KB", flush=True)
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="of a notebook; default: all")
    parser.add_argument("--check", action="store_true", help="compare, and write nothing")
    given = parser.parse_args()
    wrong = run_all(given.check, given.names)
    if wrong:
        print(
            "\n".join([*wrong, f"These outputs are old: `{docs_numbers.COMMAND}` renews them."]),
            file=sys.stderr,
        )
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
