"""A data set: what is missing of it, and its frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from physic_core.errors import InputError
from physic_core.files import read_text, unreadable

if TYPE_CHECKING:
    import click

    from physic_bench.types import Frame

_Item = TypeVar("_Item")
_MAX_LIST_BYTES = 100_000_000


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


@dataclass(frozen=True)
class DataSet:
    """One data set; a file of this package each.

    Attributes:
        name: of the command.
        description: what to get where under which terms, the files of ROOT and how it is measured,
            as Markdown.
        missing: returns everything that is missing in ROOT, a sentence each. Arguments are ROOT,
            whether pictures are needed, and the options.
        frames: returns the frames. Arguments are ROOT, the function that chooses among all names,
            the user's body model files, and the options; it raises InputError if files contradict
            each other.
        options: of the command, beside those of all data sets.
    """

    name: str
    description: str
    missing: Callable[..., list[str]]
    frames: Callable[..., FrameSet]
    options: tuple[click.Option, ...] = ()


@dataclass(frozen=True)
class FrameChoice:
    """Selection of the frames to evaluate.

    Attributes:
        file: text file with one frame per line; "#" begins a comment. None is all.
        limit: at most so many, evenly spaced; None is all.
    """

    file: Path | None = None
    limit: int | None = None

    def __call__(self, names: Sequence[str]) -> list[str]:
        """Return the chosen names.

        Raises:
            InputError: the file cannot be read, or lists a frame that there is not.
        """
        if self.file is None:
            return evenly_spaced(names, self.limit)
        try:
            lines = read_text(self.file, _MAX_LIST_BYTES).splitlines()
        except (OSError, ValueError) as error:
            why = unreadable(error) if isinstance(error, OSError) else error
            raise InputError(f"cannot read the list of frames {self.file}: {why}") from error
        listed = [line.split("#")[0].strip().strip("/") for line in lines]
        listed = list(dict.fromkeys(name for name in listed if name))
        if unknown := sorted(set(listed) - set(names)):
            raise InputError(
                f"{self.file} lists frames that do not exist: {', '.join(unknown[:5])}"
            )
        return evenly_spaced(listed, self.limit)


def evenly_spaced(items: Sequence[_Item], count: int | None) -> list[_Item]:
    """Return ``count`` items, evenly spaced over all; all of them for None."""
    if count is None or count >= len(items):
        return list(items)
    return [items[k * len(items) // count] for k in range(count)]
