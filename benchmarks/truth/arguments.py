"""Arguments of the programs that run a preset on data sets of photos."""

from __future__ import annotations

import argparse
from pathlib import Path

from .sets import SETS


def add_arguments_of_photos(parser: argparse.ArgumentParser, out: Path) -> None:
    """Add the arguments that choose photos, preset, settings and the folder of results, by default ``out``."""
    parser.add_argument("data", nargs="*", type=Path, help="folders that hold the data sets")
    parser.add_argument("--out", type=Path, default=out, help="for results and the table")
    parser.add_argument("--preset", default="embedded", help="preset of physic run")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="KEY=VALUE", help="one setting")
    parser.add_argument("--sets", default=",".join(SETS), help="data sets, with commas between them")
    parser.add_argument("--photos", type=int, help="the first N of each data set")
