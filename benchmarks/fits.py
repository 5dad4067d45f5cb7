"""What benchmarks share that fit numbers: the command line, parts of the photos, and writing."""

from __future__ import annotations

import argparse
import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.files.npz import write_arrays

if TYPE_CHECKING:
    from numpy.typing import NDArray

FOLDS = 10


def parser_of(name: str, doc: str | None, *, fits: bool = True) -> argparse.ArgumentParser:
    """Return the parser of a benchmark with this docstring; one that fits has ``--write``."""
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks {name}", description=(doc or "").partition("\n")[0]
    )
    if fits:
        parser.add_argument("--write", action="store_true", help="write the fitted file")
    return parser


def write_record(record: Mapping[str, Any], file: Path, *, write: bool) -> None:
    """Print what was fitted, and write it to the file that is shipped if asked."""
    text = json.dumps(record, indent=2)
    print(text)
    if write:
        file.write_text(text + "\n")


def write_numbers(
    numbers: Mapping[str, NDArray[Any]], file: Path, out: Path, *, write: bool
) -> None:
    """Write fitted arrays to a folder, and to the file that is shipped if asked."""
    for each in (out / file.name, *([file] if write else [])):
        write_arrays(each, numbers, stored="f")
        print(f"wrote {each}")


def name_in_sets(photo: str) -> str:
    """Return a name that a photo has in all sets: the number that its source gave it, else the end
    of its name.
    """
    numbers = re.findall(r"\d{6,}", photo)
    return numbers[-1] if numbers else re.sub("^tfjs(-models_)?_", "", photo)


def fold_of(group: str) -> int:
    """Return the fold of what is left out at once."""
    return hashlib.sha256(f"{group}fold".encode()).digest()[0] % FOLDS
