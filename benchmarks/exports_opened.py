"""Export results to every format, and open each file with a reader that a user has.

    python -m benchmarks exports_opened RESULT ... [--format NAME ...] [--body-model FILE]

A row of the table is a format: how many of the exported results its reader opened with all people,
and the largest difference between what it reads and what the result has, of all people and all
their vertices, joints or keypoints, in the frame and unit of the file. A result that a format
refuses counts apart, with our reason below the table. A reader that is not installed opens nothing,
and its row says what to install. Returns 1 if a reader fails, a person is missing, or a difference
exceeds the limit of its row.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context

from physic_core import InputError, Reconstruction, find_exporter, find_exporters
from physic_core.visual.export.request import export_frame

from . import export_readers as readers


@dataclass(frozen=True)
class Reader:
    """Reader of a format.

    Attributes:
        distribution: that a user installs; "" for Python itself.
        module: that it is imported as.
        read: opens the files.
        compares: what of a result, with its unit.
        limit: largest difference, in this unit.
        options: of the export.
    """

    distribution: str
    module: str
    read: Callable[[readers.Files], readers.Opened]
    compares: str
    limit: float
    options: dict[str, bool] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Distribution and version; what to install if it is not there."""
        if not self.distribution:
            return "Python"
        if importlib.util.find_spec(self.module) is None:
            return f"{_MISSING}pip install {self.distribution}"
        return f"{self.distribution} {importlib.metadata.version(self.distribution)}"


_MISSING = "not opened: "
_NO_READER = f"{_MISSING}this script has no reader"
_CV2 = "opencv-python-headless", "cv2"
_LEAN = {"keep_lean": True}  # people are not turned until they balance

READERS = {
    "amass": Reader("numpy", "numpy", readers.read_amass, "pelvis, m", 0.05),
    "bvh": Reader("bvhio", "bvhio", readers.read_bvh, "55 joints, m", 1e-4),
    "coco": Reader("pycocotools", "pycocotools", readers.read_coco, "keypoints, px", 1e-3),
    "colmap": Reader("pycolmap", "pycolmap", readers.read_colmap, "scene, m", 1e-4),
    "depth": Reader(*_CV2, readers.read_depth, "depth, m", 6e-4),
    "exr": Reader("OpenEXR", "OpenEXR", readers.read_exr, "depth, m", 1e-4),
    "glb": Reader("pygltflib", "pygltflib", readers.read_glb, "vertices, m", 1e-3),
    "keypoints": Reader("", "csv", readers.read_keypoints, "keypoints, px", 0.01),
    "mjcf": Reader("mujoco", "mujoco", readers.read_mjcf, "22 joints, m", 1e-3, _LEAN),
    "mot": Reader("opensim", "opensim", readers.read_mot, "hips and knees, degrees", 1e-3),
    "nerfstudio": Reader(*_CV2, readers.read_nerfstudio, "scene, m", 2e-3),
    "obj": Reader("trimesh", "trimesh", readers.read_obj, "vertices, m", 1e-4),
    "ply": Reader("plyfile", "plyfile", readers.read_ply, "vertices, m", 1e-4),
    "rrd": Reader("rerun-sdk", "rerun", readers.read_rrd, "vertices, m", 1e-4),
    "trc": Reader("opensim", "opensim", readers.read_trc, "22 joints, m", 1e-4),
    "urdf": Reader("yourdfpy", "yourdfpy", readers.read_urdf, "22 joints, m", 1e-3, _LEAN),
    "usd": Reader("usd-core", "pxr", readers.read_usd, "vertices, m", 1e-3),
}
"""Format -> its reader."""


@dataclass(frozen=True)
class Outcome:
    """What became of a result.

    Attributes:
        difference: the largest; None if it was not opened with all people.
        refused: why the format refuses the result; "" if it was exported.
        fault: why it was not opened; "" if it was.
    """

    difference: float | None = None
    refused: str = ""
    fault: str = ""


def outcome_of(form: str, folder: str, body_model: str | None = None) -> Outcome:
    """Export the result of a folder to a format, open the files, and compare."""
    reader = READERS[form]
    result = Reconstruction.load(folder)
    up = find_exporter(form).record.ups[0]
    with tempfile.TemporaryDirectory() as made:
        try:
            paths = result.export(made, form, body_model=body_model, **reader.options).files
        except InputError as error:
            return Outcome(refused=str(error))
        matrix = export_frame(result.scene.level, up).from_camera
        files = readers.Files(result, paths, matrix)
        try:
            got = reader.read(files)
        except Exception as error:  # whatever a reader raises is what its user sees
            return Outcome(fault=f"{type(error).__name__}: {error}")
    if got.people not in (None, len(files.bodies)):
        return Outcome(fault=f"{got.people} of {len(files.bodies)} people")
    return Outcome(got.difference)


def outcomes_of(form: str, folders: Sequence[str], body_model: str | None) -> list[Outcome]:
    """Return the outcome of each folder.

    Each format has a process of its own: the libraries exclude one another, and some end the
    process on a file that they do not like.
    """
    made = []
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        for folder in folders:
            try:
                made.append(pool.submit(outcome_of, form, folder, body_model).result())
            except BrokenProcessPool:
                made.append(Outcome(fault="the reader ended the process"))
                break
    return made + [Outcome(fault="not tried")] * (len(folders) - len(made))


def row_of(form: str, outcomes: Sequence[Outcome]) -> str:
    """Return the row of a format."""
    reader = READERS[form]
    written = [one for one in outcomes if not one.refused]
    differences = [one.difference for one in written if one.difference is not None]
    cells = (
        f"`{form}`",
        reader.title,
        f"{len(differences)} of {len(written)}",
        str(len(outcomes) - len(written) or ""),
        reader.compares,
        f"{max(differences):.2g}" if differences else "",
    )
    return f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |")


def is_wrong(form: str, outcome: Outcome) -> bool:
    """Return whether a result was not opened, or differs by more than the limit."""
    too_far = outcome.difference is not None and outcome.difference > READERS[form].limit
    return bool(outcome.fault) or too_far


def main() -> int:
    """Print the table, reasons and faults."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks exports_opened", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("results", nargs="+", help="folders of results")
    parser.add_argument("--format", nargs="+", help="formats (default: all)")
    parser.add_argument("--body-model", help="SMPL-X file of yours, for amass")
    args = parser.parse_args()
    print("| format | reader | opened | refused | compared, unit | largest difference |")
    print("|---|---|---:|---:|---|---:|")
    said: list[str] = []
    wrong = False
    for form in args.format or [one.record.name for one in find_exporters()]:
        if form not in READERS or READERS[form].title.startswith(_MISSING):
            print(
                f"| `{form}` | {READERS[form].title if form in READERS else _NO_READER} | | | | |"
            )
            wrong = True
            continue
        outcomes = outcomes_of(form, args.results, args.body_model)
        print(row_of(form, outcomes), flush=True)
        for folder, one in zip(args.results, outcomes, strict=True):
            if is_wrong(form, one):
                wrong = True
                said.append(f"{form}, {folder}: {one.fault or f'differs by {one.difference:.3g}'}")
        said += sorted({f"{form} refuses: {one.refused}" for one in outcomes if one.refused})
    print("", *said, sep="\n")
    return int(wrong)
