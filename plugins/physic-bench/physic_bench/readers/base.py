"""A reader of results: where the file of a frame is, what is in it, and in which frame of reference."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_bench.bodies import BodyFiles, PosedBody
from physic_bench.contract import PredictedPerson
from physic_bench.damage import DamagedFrameError, as_numbers, damaged_file_error, naming, require_finite
from physic_bench.validation import check_prediction
from physic_core.files.atomic import open_regular
from physic_core.files.npz import read_arrays

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.contract import Frame, Prediction

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class ResultReader(ABC):
    """Reads one method's results; it can be pickled.

    Attributes:
        folder: of the results.
        bodies: the user's body model files, for results that hold parameters.
    """

    name: ClassVar[str]
    layout: ClassVar[str]
    """Which files it reads, for messages."""

    folder: Path
    bodies: BodyFiles

    @abstractmethod
    def locate(self, frame: Frame) -> Path | None:
        """Return the file or folder with the result of a frame, or None if there is none."""

    @abstractmethod
    def read(self, path: Path, frame: Frame) -> Prediction:
        """Read a result.

        Raises:
            DamagedFrameError: it is damaged.
            InputError: a body model file is missing.
        """

    def result(self, frame: Frame) -> Prediction | None:
        """Return the result of a frame, or None if there is none.

        Raises:
            DamagedFrameError: it is damaged, or its arrays do not fit together.
            InputError: a body model file is missing.
        """
        with naming(self.folder):
            path = self.locate(frame)
        if path is None:
            return None
        with naming(path):
            found = self.read(path, frame)
            check_prediction(found)
        return found


def file_names(frame: Frame) -> Iterator[str]:
    """Yield the names that other tools give to a frame: its id, with and without folders, and its picture's."""
    yield frame.id
    yield frame.id.replace("/", "_")
    yield frame.id.replace("/", "__")
    if frame.picture is not None:
        yield frame.picture.path.stem
    if "/" in frame.id:
        yield frame.id.rpartition("/")[2]


def first_file(folder: Path, frame: Frame, *patterns: str) -> Path | None:
    """Return the first file that exists of patterns such as "prox/{name}.npz", for all names of a frame."""
    for pattern in patterns:
        for name in file_names(frame):
            path = folder / pattern.format(name=name)
            if path.exists():
                return path
    return None


def archive_arrays(path: Path) -> dict[str, Any]:
    """Return all arrays of an .npz file, without unpickling.

    Raises:
        DamagedFrameError: it is missing, damaged, or holds Python objects.
    """
    try:
        with open_regular(path) as stream:
            return dict(read_arrays(stream))
    except FileNotFoundError as error:
        raise DamagedFrameError(f"there is no file {path}") from error
    except ValueError as error:
        reason = (
            "it holds Python objects, which can run code: save arrays of numbers"
            if "Python objects" in str(error)
            else error
        )
        raise DamagedFrameError(f"{path} cannot be read: {reason}") from error
    except Exception as error:  # of zipfile and its compressors, which have many
        raise damaged_file_error(path, error) from error


def contact_of(given: Any) -> NDArray[np.bool_] | None:
    """Return contact (V,) bool of probabilities, or None.

    Raises:
        DamagedFrameError: they are not finite numbers.
    """
    if given is None:
        return None
    found = require_finite(as_numbers(given, "the contact").reshape(-1), "the contact")
    touching: NDArray[np.bool_] = found >= 0.5
    return touching


def person_of_body(body: PosedBody, contact: Any = None) -> PredictedPerson:
    """Return a posed body as a person."""
    return PredictedPerson(
        vertices=body.vertices,
        topology=body.topology,
        joints=body.joints,
        joint_names=body.names,
        contact=contact_of(contact),
    )


def person_of_vertices(vertices: Array, topology: str, bodies: BodyFiles, contact: Any = None) -> PredictedPerson:
    """Return a mesh as a person, with joints by the model file's regressor if there is one (an approximation)."""
    joints, names = bodies.regressed_joints(vertices, topology) or (None, ())
    return PredictedPerson(
        vertices=vertices,
        topology=topology,
        joints=joints,
        joint_names=names,
        contact=contact_of(contact),
    )
