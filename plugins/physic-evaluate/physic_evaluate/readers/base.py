"""A reader of results: where the file of a frame is, what is in it, and in which frame of reference."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_core.errors import InputError
from physic_evaluate.bodies import SMPL_NAMES, BodyFiles, PosedBody
from physic_evaluate.contract import PredictedPerson

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_evaluate.contract import Frame, Prediction

    Array = NDArray[np.float64]

__all__ = ["ResultReader", "archive_arrays", "file_names", "first_file", "person_of_body", "person_of_vertices"]


@dataclass(frozen=True)
class ResultReader(ABC):
    """Reads one method's results; it can be pickled.

    Attributes:
        folder: of the results.
        bodies: the user's body model files, for results that hold parameters.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    layout: ClassVar[str]
    """Which files it reads, as shown by ``physic evaluate readers``."""
    assumed: ClassVar[str] = "camera"
    """Frame of reference of the files: a key of ``physic_evaluate.frame_of_results.ALTERNATIVES``."""

    folder: Path
    bodies: BodyFiles

    @abstractmethod
    def locate(self, frame: Frame) -> Path | None:
        """Return the file or folder with the result of a frame, or None if there is none."""

    @abstractmethod
    def read(self, path: Path, frame: Frame) -> Prediction:
        """Read a result.

        Raises:
            InputError: it is damaged, or a body model file is missing.
        """

    def result(self, frame: Frame) -> Prediction | None:
        """Return the result of a frame, or None if there is none.

        Raises:
            InputError: it is damaged, or its arrays do not fit together.
        """
        path = self.locate(frame)
        if path is None:
            return None
        try:
            found = self.read(path, frame)
        except (LookupError, TypeError, ValueError) as error:
            what = f"{type(error).__name__}: {error}"
            raise InputError(
                f"{path} does not have the content that the reader '{self.name}' expects ({what})"
            ) from error
        return _checked(found, path)


def _checked(found: Prediction, path: Path) -> Prediction:
    """Refuse what would make figures NaN; joints may be NaN where a method has none."""
    if found.K is not None and not np.isfinite(found.K).all():
        raise InputError(f"{path}: the camera K has values that are not finite")
    for row, person in enumerate(found.people):
        for what, points in (("vertices", person.vertices), ("joints", person.joints)):
            if points is not None and (points.ndim != 2 or points.shape[1] != 3):
                raise InputError(f"{path}: the {what} of person {row} must have the shape (n, 3), got {points.shape}")
        if person.joints is not None and len(person.joints) != len(person.joint_names):
            raise InputError(
                f"{path}: person {row} has {len(person.joints)} joints, but {len(person.joint_names)} names of joints"
            )
        if person.vertices is not None and not np.isfinite(person.vertices).all():
            bad = int((~np.isfinite(person.vertices).all(1)).sum())
            raise InputError(f"{path}: {bad} of the {len(person.vertices)} vertices of person {row} are not finite")
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
    """Return the first file that exists of patterns such as "results/{name}/000.pkl", for all names of a frame.

    "{sequence}" stands for the frame's sequence. A name without the sequence counts only in a folder of the sequence.
    """
    for pattern in patterns:
        for name in file_names(frame):
            path = folder / pattern.format(name=name, sequence=frame.sequence)
            if path.exists():
                return path
    return None


def archive_arrays(path: Path) -> dict[str, Any]:
    """Return all arrays of an .npz file, without unpickling.

    Raises:
        InputError: it is missing, damaged, or holds Python objects.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError as error:
        raise InputError(f"there is no file {path}") from error
    except ValueError as error:
        reason = (
            "it holds Python objects, which can run code: save arrays of numbers" if "pickle" in str(error) else error
        )
        raise InputError(f"{path} cannot be read: {reason}") from error
    except Exception as error:  # of zipfile and its compressors, which have many
        raise InputError(f"{path} cannot be read: it is damaged or cut off, copy it again") from error


def person_of_body(body: PosedBody, contact: Any = None, moved: Array | None = None) -> PredictedPerson:
    """Return a posed body as a person, optionally moved (3,) m."""
    by = np.zeros(3) if moved is None else np.asarray(moved, np.float64).reshape(3)
    return PredictedPerson(
        vertices=body.vertices + by,
        topology=body.topology,
        joints=body.joints + by,
        joint_names=body.names,
        contact=None if contact is None else np.asarray(contact).reshape(-1) >= 0.5,
    )


def person_of_vertices(
    vertices: Array, topology: str, bodies: BodyFiles, contact: Any = None, joints: Any = None
) -> PredictedPerson:
    """Return a mesh as a person, with joints by the model file's regressor if there is one (an approximation)."""
    names: tuple[str, ...] = ()
    if joints is None:
        found = bodies.regressed_joints(vertices, topology)
        joints, names = (None, ()) if found is None else found
    elif len(joints) >= 22:
        names = SMPL_NAMES[:22]
        joints = np.asarray(joints)[:22]
    return PredictedPerson(
        vertices=vertices,
        topology=topology,
        joints=joints,
        joint_names=names,
        contact=None if contact is None else np.asarray(contact).reshape(-1) >= 0.5,
    )
