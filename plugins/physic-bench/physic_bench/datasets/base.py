"""A data set: how to get it, what is missing of it, and its frames."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from physic_bench.damage import DamagedFrameError
from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_bench.bodies import BodyFiles
    from physic_bench.contract import Frame, Prediction

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class DataSource:
    """Where a part of a data set comes from.

    Attributes:
        what: the part.
        where: site or repository.
        terms: licence, in words.
    """

    what: str
    where: str
    terms: str


@dataclass(frozen=True)
class Description:
    """What a user has to know of a data set.

    Attributes:
        title: one sentence.
        sources: what to get where.
        tree: folders and files below ROOT, as text.
        notes: how it is measured, a sentence each.
    """

    title: str
    sources: tuple[DataSource, ...]
    tree: str
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class FrameSet:
    """The frames of a data set that are evaluated.

    Attributes:
        frames: in order.
        notes: decisions that the results depend on, a sentence each; printed.
        left_out: frame id -> why it is not evaluated.
    """

    frames: tuple[Frame, ...]
    notes: tuple[str, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)


def option(default: str, words: str, metavar: str) -> Any:
    """Return a field of a data set's options, which becomes an option of its command with this help."""
    return field(default=default, metadata={"help": words, "metavar": metavar})


@dataclass(frozen=True)
class NoOptions:
    """The command of the data set has no option of its own."""


class DataSet(ABC):
    """One data set; a file of this package each."""

    name: ClassVar[str]
    summary: ClassVar[str]
    Options: ClassVar[type[Any]] = NoOptions
    """A frozen dataclass whose fields are made by :func:`option`."""

    @abstractmethod
    def describe(self) -> Description:
        """Return what to get where, under which terms, and the folders that are expected."""

    @abstractmethod
    def check(self, root: Path, options: Any, *, pictures: bool = True) -> list[str]:
        """Return everything that is missing in ROOT, a sentence each; empty if nothing is.

        Args:
            root: of the data set.
            options: of the class ``Options``.
            pictures: whether the pictures are needed, which results of methods can do without.
        """

    @abstractmethod
    def frames(self, root: Path, options: Any, bodies: BodyFiles, limit: int | None = None) -> FrameSet:
        """Return the frames.

        Args:
            root: of the data set.
            options: of the class ``Options``.
            bodies: the user's body model files.
            limit: about how many frames, see :func:`evenly`; None for all.

        Raises:
            InputError: a file is damaged, or its content contradicts another.
        """

    def complete(self, found: FrameSet, results: Mapping[str, Prediction | None], method: str, root: Path) -> FrameSet:
        """Return the frames with truth that only results give, such as triangulated joints; by default unchanged.

        Args:
            found: of :meth:`frames`.
            results: frame id -> result of the first method.
            method: its name.
            root: of the data set.
        """
        return found

    def needs_results(self, found: FrameSet) -> bool:
        """Return whether :meth:`complete` changes anything."""
        return False


def evenly(items: Sequence[_Item], count: int | None) -> list[_Item]:
    """Return ``count`` items, evenly spaced over all; all of them for None."""
    if count is None or count >= len(items):
        return list(items)
    return [items[k * len(items) // count] for k in range(count)]


def listed_frames(file: str) -> list[str]:
    """Return the names of a list of frames, one per line; "#" begins a comment.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        lines = Path(file).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the list of frames {file} cannot be read") from error
    names = [line.split("#")[0].strip().strip("/") for line in lines]
    return list(dict.fromkeys(name for name in names if name))


def read_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises:
        DamagedFrameError: it cannot be read, or is not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DamagedFrameError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise DamagedFrameError(f"{path} is not valid JSON ({error}): it is damaged or truncated") from error


def missing_dataset_files(root: Path, names: Sequence[tuple[str, str]]) -> list[str]:
    """Return a sentence for each path (relative, what it is) or pattern that nothing exists for."""
    return [f"{root / name}: {what}" for name, what in names if next(root.glob(name), None) is None]
