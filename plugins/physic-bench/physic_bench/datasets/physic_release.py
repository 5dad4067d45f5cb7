"""The published results of the paper's first author as a reference: how far this engine ends from theirs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from physic_bench.cameras import Camera
from physic_bench.contract import Frame, TruePerson, Truth
from physic_bench.damage import DamagedFileError, naming, number_array, require_finite
from physic_bench.datasets.base import DataSet, Description, FrameSet, Source, option
from physic_bench.readers.base import archive_arrays
from physic_bench.readers.physic_release import people_of_release
from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_bench.bodies import BodyFiles

FOLDERS = ("release_data", "release_data_full", ".")

TREE = """\
ROOT/
  release_data/prox/<recording>/<frame>.npz     init_*, final_*, K, contact_deco, scene_points, scene_normals, ...
  release_data/rich/<frame>.npz"""


@dataclass(frozen=True)
class ReleaseOptions:
    """Options of the command.

    Attributes:
        every: step through all files.
    """

    every: int = option(1, "Every N-th file.", metavar="N")


class PhysicReleaseSet(DataSet):
    """Reads the final bodies as the reference."""

    name: ClassVar[str] = "physic-release"
    summary: ClassVar[str] = "the paper's own results as a reference"
    Options: ClassVar[type[Any]] = ReleaseOptions

    def describe(self) -> Description:
        """Return what the release is."""
        return Description(
            "The published results of the paper's authors as a reference: distances from their final bodies.",
            (
                Source(
                    "physic-eval-release (25 MB for release_data)",
                    "the data set of that name of the paper's first author, on a model hub",
                    "see its card",
                ),
                Source(
                    "SMPL-X model file SMPLX_NEUTRAL.npz (--smplx)",
                    "the site of SMPL-X, smpl-x.is.tue.mpg.de, with an account",
                    "SMPL-X licence: non-commercial research",
                ),
            ),
            TREE,
            (
                "The reference is a result, no measured truth. To score it against truth, give its folder as "
                "--from-release to `physic evaluate prox` or `rich`: rows of its start and end, and of this engine "
                "from its start.",
                "--from-release ROOT runs this engine from the published start on the published scene points.",
                "There are no pictures: only results can be scored.",
            ),
        )

    def check(self, root: Path, options: ReleaseOptions, *, pictures: bool = True) -> list[str]:
        """Return what is missing."""
        missing = [] if _files(root) else [f"{root / 'release_data/prox/*/*.npz'}: files of the release"]
        if pictures:
            missing.append(f"no pictures: give --from-release {root}, or --results")
        return missing

    def frames(self, root: Path, options: ReleaseOptions, bodies: BodyFiles) -> FrameSet:
        """Return a frame for each file."""
        if not bodies.has("smplx"):
            raise InputError("the release holds parameters of SMPL-X: give --smplx FILE or FOLDER")
        frames, left_out = [], {}
        for name, file in list(_files(root).items())[:: options.every]:
            try:
                K = require_finite(number_array(archive_arrays(file), "K", file, (3, 3)), f"{file}: 'K'")
            except DamagedFileError as error:
                left_out[name] = str(error)
                continue
            camera = Camera(K, max(round(2 * K[0, 2]), 1), max(round(2 * K[1, 2]), 1))
            frames.append(Frame(name, name.rpartition("/")[0] or name, partial(_truth, file, bodies), camera))
        return FrameSet(tuple(frames), ("the reference is the published end, a result: no measured truth",), left_out)


def _truth(file: Path, bodies: BodyFiles) -> Truth:
    with naming(file):
        people = people_of_release(archive_arrays(file), "final", file, bodies)
    return Truth(
        tuple(
            TruePerson(
                str(i),
                joints=person.joints,
                joint_names=person.joint_names,
                joint_source="published end",
                vertices=person.vertices,
                topology=person.topology,
                contact=person.contact,
            )
            for i, person in enumerate(people)
        )
    )


def _files(root: Path) -> dict[str, Path]:
    """Return the files by the name that the frame has in its data set."""
    found: dict[str, Path] = {}
    for folder in FOLDERS:
        for kind in ("prox", "rich"):
            for file in sorted((root / folder / kind).rglob("*.npz")):
                found.setdefault(file.relative_to(root / folder / kind).with_suffix("").as_posix(), file)
        if found:
            break
    return found


DATA_SET = PhysicReleaseSet()
