"""Reconstruct every photo of a folder and print a Markdown table of how consistent each result is.

    python tools/photo_table.py PHOTOS [--config FILE_OR_PRESET] [--out RESULTS]

A photo that ends in an error has its message in the table; the exit status is 1 only where a photo crashed, that is,
ended in something else than an error that PhySIC raises on purpose.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
import traceback
from pathlib import Path

from consistency import consistency, summarise

from physic_core.body import load_body
from physic_core.errors import PhysicError
from physic_core.pipeline.run import reconstruct

SUFFIXES = {".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp", ".avif", ".heic"}
HEADER = (
    "photo",
    "people",
    "seconds",
    "keypoint error, px",
    "contact distance, cm",
    "> 3 cm inside, %",
    "lowest sole, cm",
    "lean, °",
    "message",
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photos", type=Path, help="folder of photos")
    parser.add_argument("--config", help="TOML file or name of a preset")
    parser.add_argument("--out", type=Path, help="folder that takes one folder of results a photo")
    parser.add_argument("--body", default="embedded", help='"embedded" or an SMPL-X file')
    arguments = parser.parse_args()
    os.environ["PHYSIC_CACHE"] = "off"  # the seconds are those of a first run
    model = load_body(arguments.body)
    crashed = False
    print("| " + " | ".join(HEADER) + " |")
    print("|" + "---|" * len(HEADER), flush=True)
    for path in sorted(arguments.photos.iterdir()):
        if path.suffix.lower() not in SUFFIXES:
            continue
        try:
            cells = row(path, arguments.config, arguments.out, model)
        except PhysicError as error:
            cells = ["", "", "", "", "", "", "", str(error)]
        except Exception as error:
            traceback.print_exc()
            crashed = True
            cells = ["", "", "", "", "", "", "", f"CRASH: {type(error).__name__}: {error}"]
        print(
            "| " + " | ".join([path.name, *(cell.replace("|", "/").replace("\n", " ") for cell in cells)]) + " |",
            flush=True,
        )
    return int(crashed)


def row(path: Path, config: str | None, out: Path | None, model) -> list[str]:
    """The cells of one photo, after its name."""
    start = time.perf_counter()
    result = reconstruct(path, config)
    seconds = time.perf_counter() - start - sum(stage.load_seconds for stage in result.stages)
    if out is not None:
        result.save(str(out / path.name))
    people = consistency(result, model)
    summary = summarise(result, people)
    failed = sum(bool(person.failed_checks) for person in result.people)
    notes = [f"{failed} failed a check"] if failed else []
    if result.warnings:
        notes.append(f"{len(result.warnings)} warnings")
    return [
        str(summary.people),
        f"{seconds:.1f}",
        number(summary.keypoint_error_px, 1),
        number(100 * summary.contact_distance, 1),
        number(100 * summary.inside_share, 1),
        each([100 * person.sole_height for person in people]),
        each([person.lean_deg for person in people]),
        ", ".join(notes),
    ]


def number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def each(values: list[float]) -> str:
    """One number a person; a dash where there is none."""
    return " ".join(number(value, 1) for value in values) if any(map(math.isfinite, values)) else "-"


if __name__ == "__main__":
    sys.exit(main())
