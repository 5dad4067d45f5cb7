"""Export results, and open the files with programs of users that no test has.

    python -m benchmarks exports_opened RESULT ... [--format NAME ...]

A row of the table is a format and a program: how many of the exported results it opened with all
people, the largest difference between what it reads and what the result has, of all people, in the
frame and unit of the file, and what else of the first result arrives. A result that a format
refuses counts apart, with our reason below the table. A program that is not installed opens
nothing, and its row says what to install. Returns 1 if a program fails, a person is missing, or a
difference exceeds the limit of its row.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context

from physic_core import InputError, Reconstruction, find_exporter
from physic_core.export import export_frame

from . import export_readers as readers
from .export_readers import Opened
from .fits import parser_of


@dataclass(frozen=True)
class Reader:
    """Program that opens a format.

    Attributes:
        form: format.
        distribution: that a user installs.
        module: that it is imported as.
        read: opens the files.
        compares: what of a result, with its unit.
        limit: largest difference, in this unit.
    """

    form: str
    distribution: str
    module: str
    read: Callable[[readers.Files], Opened]
    compares: str
    limit: float

    @property
    def missing(self) -> str:
        """What to install; "" if the program is there."""
        there = importlib.util.find_spec(self.module)
        return "" if there else f"not opened: pip install {self.distribution}"

    @property
    def title(self) -> str:
        """Distribution and version."""
        return f"{self.distribution} {importlib.metadata.version(self.distribution)}"


_OPENSIM = "opensim", "opensim"
_VALIDATOR = "omniverse-asset-validator", "omni"

READERS = (
    Reader("bvh", "bvhio", "bvhio", readers.read_bvh, "55 joints, m", 1e-4),
    Reader("colmap", "pycolmap", "pycolmap", readers.read_colmap, "scene, m", 1e-4),
    Reader("glb", "bpy", "bpy", readers.read_blender, "bounds, m", 1e-3),
    Reader("mot", *_OPENSIM, readers.read_mot, "hips and knees, degrees", 1e-3),
    Reader("ply", "open3d", "open3d", readers.read_open3d_points, "vertices, m", 1e-4),
    Reader("trc", *_OPENSIM, readers.read_trc, "22 joints, m", 1e-4),
    Reader("urdf", "yourdfpy", "yourdfpy", readers.read_urdf, "22 joints, m", 1e-3),
    Reader("usd", *_VALIDATOR, readers.read_asset_validator, "failures", 0.5),
)


def outcome_of(reader: Reader, folder: str) -> Opened:
    """Export the result of a folder to the format of a reader, open the files, and compare."""
    result = Reconstruction.load(folder)
    with tempfile.TemporaryDirectory() as made:
        up = find_exporter(reader.form).record.ups[0]
        # people are not turned until they balance
        options = {"keep_lean": True} if reader.form == "urdf" else {}
        try:
            paths = result.export(made, reader.form, **options).files
        except InputError as error:
            return Opened(refused=str(error))
        files = readers.Files(result, paths, export_frame(result.scene.level, up).from_camera)
        try:
            got = reader.read(files)
        except Exception as error:  # whatever a reader raises is what its user sees
            return Opened(fault=f"{type(error).__name__}: {error}")
    if got.people not in (None, len(files.bodies)):
        return Opened(fault=f"{got.people} of {len(files.bodies)} people")
    return got


def outcomes_of(reader: Reader, folders: Sequence[str]) -> list[Opened]:
    """Return the outcome of each folder.

    Each reader has a process of its own: the libraries exclude one another, and some end the
    process on a file that they do not like.
    """
    made = []
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        for folder in folders:
            try:
                made.append(pool.submit(outcome_of, reader, folder).result())
            except BrokenProcessPool:
                made.append(Opened(fault="the reader ended the process"))
                break
    return made + [Opened(fault="not tried")] * (len(folders) - len(made))


def row_of(reader: Reader, outcomes: Sequence[Opened]) -> str:
    """Return the row of a reader."""
    written = [one for one in outcomes if not one.refused]
    opened = [one for one in written if not one.fault]
    cells = (
        f"`{reader.form}`",
        reader.title,
        f"{len(opened)} of {len(written)}",
        str(len(outcomes) - len(written) or ""),
        reader.compares,
        f"{max(one.difference for one in opened):.2g}" if opened else "",
        next((one.more for one in opened), ""),
    )
    return f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |")


def is_wrong(reader: Reader, outcome: Opened) -> bool:
    """Return whether a result was not opened, or differs by more than the limit."""
    return bool(outcome.fault) or outcome.difference > reader.limit


def main() -> int:
    """Print the table, reasons and faults."""
    parser = parser_of("exports_opened", __doc__, fits=False)
    parser.add_argument("results", nargs="+", help="folders of results")
    forms = list(dict.fromkeys(reader.form for reader in READERS))
    parser.add_argument("--format", nargs="+", choices=forms, default=forms, metavar="NAME")
    args = parser.parse_args()
    print(
        "| format | reader | opened | refused | compared, unit | largest difference | what else |",
        "|---|---|---:|---:|---|---:|---|",
        sep="\n",
    )
    said: list[str] = []
    wrong = False
    for reader in (one for one in READERS if one.form in args.format):
        if reader.missing:
            print(f"| `{reader.form}` | {reader.missing} | | | | | |")
            wrong = True
            continue
        outcomes = outcomes_of(reader, args.results)
        print(row_of(reader, outcomes), flush=True)
        for folder, one in zip(args.results, outcomes, strict=True):
            if is_wrong(reader, one):
                wrong = True
                why = one.fault or f"differs by {one.difference:.3g}"
                said.append(f"{reader.form}, {reader.title}, {folder}: {why}")
            if one.refused:
                said.append(f"{reader.form} refuses: {one.refused}")
    print("", *dict.fromkeys(said), sep="\n")
    return int(wrong)
