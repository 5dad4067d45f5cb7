"""Results of MOVER: parameters of all frames of a video in one pickle, or one pickle per frame."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from physic_evaluate.contract import Prediction
from physic_evaluate.damage import DamagedFileError, number_array
from physic_evaluate.pickled import cached_pickle
from physic_evaluate.readers.base import ResultReader, first_file
from physic_evaluate.readers.smplifyx_files import person_of_parameters
from physic_evaluate.wording import counted

if TYPE_CHECKING:
    from physic_evaluate.contract import Frame

__all__ = ["READER", "Mover"]

ONE = ("results/split/{name}.pkl", "results/{name}.pkl", "{sequence}/results/split/{name}.pkl")
ALL = ("results/001_all.pkl", "{sequence}/results/001_all.pkl", "{sequence}/001_all.pkl")


class Mover(ResultReader):
    """Reads SMPL-X parameters; row i of the pickle of a video is its frame i."""

    name: ClassVar[str] = "mover"
    summary: ClassVar[str] = "MOVER: results/001_all.pkl of a video, or one pickle per frame"
    layout: ClassVar[str] = "SEQUENCE/results/001_all.pkl (row: the last number in FRAME), or results/FRAME.pkl"

    def locate(self, frame: Frame) -> Path | None:
        """Return the pickle of the frame, or of its sequence."""
        return first_file(self.folder, frame, *ONE, *ALL)

    def read(self, path: Path, frame: Frame) -> Prediction:
        """Pose the body by the user's SMPL-X file."""
        values = cached_pickle(path, path.stat().st_mtime_ns)
        row = 0
        if path.name == "001_all.pkl":
            # "s001_frame_00012__00.00.00.400": the frame's number, not the clock.
            numbers = re.findall(r"\d+", frame.id.rpartition("/")[2].partition("__")[0])
            count = len(number_array(values, "transl", path, (-1, 3)))
            row = int(numbers[-1]) if numbers else -1
            if not 0 <= row < count:
                raise DamagedFileError(
                    f"{path} has {counted(count, 'frame')}, and '{frame.id}' is none of them: rows count from 0"
                )
        return Prediction((person_of_parameters(values, path, self.bodies, row),))


READER = Mover
