"""Open the exports of a result with other programs, and print a row for each: version, place, and
what else arrives.

    .venv/bin/python tools/open_exports.py RESULT

RESULT is the folder of a result with a floor and a person. The ``physic`` command of ``.venv``
writes the files; the programs are installed in temporary environments, with the versions below.
``docs/exports-opened.md`` has the rows.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from physic_core import Reconstruction
from physic_core.geometry.upright import transform_points
from physic_core.visual.export.request import export_frame

READERS = Path(__file__).with_name("read_exports.py")
VERSIONS = {
    "trimesh": "5.2.0",
    "Open3D": "0.20.0",
    "pymeshlab": "2025.7.post1",
    "pygltflib": "1.16.5",
    "assimp-py": "1.1.0",
    "VTK": "9.7.2",
    "Blender": "5.0.1",
    "usd-core": "26.11",
    "rerun-sdk": "0.41.0",
    "MuJoCo": "4.0.0",
    "PyBullet": "3.2.7",
    "Pinocchio": "4.1.0",
    "yourdfpy": "0.0.60",
    "bvhio": "1.5.4",
    "pycocotools": "2.0.11",
    "OpenSim": "4.6",
    "pycolmap": "4.2.1",
}
"""Release of each program of ``read_exports.py`` in the table of ``docs/exports-opened.md``."""

FORMATS = ("glb", "ply", "usd", "mjcf", "urdf", "coco", "colmap", "bvh", "trc", "mot")
NEAR_M = 1e-3


def write_exports(result: Reconstruction, folder: Path) -> None:
    """Write the files that the programs open."""
    result.save(str(folder))
    for form in FORMATS:
        result.export(str(folder), form)


def opened(python: str, program: str, folder: Path) -> dict[str, Any]:
    """Return what a program has of the files of a folder, as ``read_exports.py`` prints it.

    Raises:
        RuntimeError: the program cannot read them.
    """
    done = subprocess.run(
        [python, str(READERS), program, str(folder)], capture_output=True, text=True
    )
    if done.returncode:
        raise RuntimeError(f"{program} cannot read its files: {done.stderr.strip()[-2000:]}")
    row: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return row


def place_error(result: Reconstruction, row: dict[str, Any]) -> float | None:
    """Return the largest difference of the bounds of person 0, metres; None without bounds."""
    if row["bounds"] is None:
        return None
    matrix = export_frame(result.scene.floor, "y").from_camera
    vertices = transform_points(matrix, result.people[0].vertices)
    wanted = np.stack([vertices.min(0), vertices.max(0)])
    return float(np.abs(np.array(row["bounds"]) - wanted).max())


def table_row(program: str, row: dict[str, Any], error: float | None) -> str:
    """Return the row of the table in ``docs/exports-opened.md``."""
    cells = [
        f"{program} {row['version']}",
        ", ".join(f"`{name}`" for name in row["files"].split(", ")),
        "" if error is None else f"{1000 * error:.1f} mm",
        row["colours"],
        "" if row["contact"] is None else "yes",
        "" if row["joints"] is None else f"{row['joints']} joints",
        row["more"],
    ]
    return f"| {' | '.join(cells)} |".replace("|  |", "| |")


def main(folder: Path, root: Path) -> int:
    """Print the table; return 1 if a program cannot read its file, or moves a person."""
    sys.path.insert(0, str(READERS.parent))
    from read_exports import PROGRAMS

    result = Reconstruction.load(str(folder))
    failed = 0
    files = root / "files"
    files.mkdir()
    write_exports(result, files)
    for program, (distribution, _, _) in PROGRAMS.items():
        # one environment each: their dependencies exclude one another
        python = root / program / "bin" / "python"
        pin = f"{distribution}=={VERSIONS[program]}"
        subprocess.run(["uv", "venv", "--quiet", str(python.parents[1])], check=True)
        subprocess.run(["uv", "pip", "install", "--quiet", "--python", python, pin], check=True)
        try:
            row = opened(str(python), program, files)
        except RuntimeError as error:
            print(error)
            failed = 1
            continue
        off = place_error(result, row)
        failed |= off is not None and off > NEAR_M
        print(table_row(program, row, off), flush=True)
    return failed


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        sys.exit(main(Path(sys.argv[1]), Path(made)))
