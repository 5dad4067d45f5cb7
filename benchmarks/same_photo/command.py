"""Measure how much the answer to a photo changes when the photo is mirrored, scaled, cropped,
compressed or grey.

    python -m benchmarks same_photo DATA OUT [--variants mirror,scale] [--photos N] [--half
    development]

Photos are drawn from the labelled ones of ``benchmarks.contact_on_photos`` with at most four
people. Those of half "development" serve to choose between versions of the code, those of half
"held" to report them. "K" is a camera that is given: that of the photo's own result, and for a crop
that camera shifted.

OUT keeps the answers by the content of the code, and the outputs of the networks: an interrupted
run continues. A row is a variant, a pair of numbers the median and the 90th percentile; three
numbers are the median, the 90th and the 95th percentile.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.contact_on_photos import samples_of
from benchmarks.fits import HALVES, half_of, parser_of
from benchmarks.truth.builds import ROOT, Question, asked, build_of, question_of
from benchmarks.truth.sets import Sample
from physic_core import Intrinsics
from physic_testing.metrics import markdown_table

from .changes import Change, change, table
from .variants import PHOTO, VARIANTS, Answer, Variant, seen

if TYPE_CHECKING:
    from benchmarks.truth.builds import Ask

MOST_PEOPLE = 4
"""Labelled people of a photo."""

CROWDS = ("lisa__jackma",)
"""Photos of more people, most of whom are not labelled: twenty take minutes."""


def main() -> int:
    """Run what is missing and print the table."""
    parser = _parser()
    given = parser.parse_args()
    samples = drawn(samples_of(given.data), given.photos, given.seed)
    samples = [sample for sample in samples if given.half in (None, half_of(sample.name))]
    known = [variant.name.removesuffix(", K") for variant in VARIANTS]
    names = {name for name in given.variants.split(",") if name}
    if unknown := names - set(known):
        parser.error(f"there is no variant {', '.join(sorted(unknown))}")
    variants = [v for v, name in zip(VARIANTS, known, strict=True) if not names or name in names]
    changes: dict[str, list[Change]] = {variant.name: [] for variant in variants}
    with asked(build_of(ROOT, "embedded", given.set), given.out) as ask:
        for number, sample in enumerate(samples, 1):
            for name, one in changes_of(question_of(sample), variants, ask).items():
                changes[name].append(one)
            words = f"[{number}/{len(samples)}] {half_of(sample.name)} {sample.name}"
            print(words, file=sys.stderr, flush=True)
    print(markdown_table(table(changes)))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = parser_of("same_photo", __doc__, fits=False)
    add = parser.add_argument
    add("data", type=Path, help="folder with contact and photos")
    add("out", type=Path)
    add("--variants", default="", help="names of variants without their K; all if empty")
    add("--photos", type=int, default=30, help="number of photos; fewer are the first of more")
    add("--seed", type=int, default=0, help="of the draw of photos")
    add("--half", choices=HALVES, help="only photos of this half; all if not given")
    words = "setting that differs"
    add("--set", action="append", default=[], metavar="KEY=VALUE", help=words)
    return parser


def drawn(samples: Sequence[Sample], count: int, seed: int) -> list[Sample]:
    """Return the first of the photos of few people, in an order that depends on their names and the
    seed alone.
    """
    chosen = [
        s for s in samples if 1 <= len(s.truth["people"]) <= MOST_PEOPLE and s.name not in CROWDS
    ]

    def order(sample: Sample) -> bytes:
        return hashlib.sha256(f"{seed} {sample.name}".encode()).digest()

    return sorted(chosen, key=order)[:count]


def changes_of(photo: Question, variants: Sequence[Variant], ask: Ask) -> dict[str, Change]:
    """Return the change by each variant of a photo."""
    height, width = photo.picture.shape[:2]

    @cache
    def answer(variant: Variant) -> Answer:
        question = replace(photo, name=f"{photo.name} {variant.name}")
        question = replace(question, picture=variant.picture(photo.picture))
        if variant.camera_is_known:
            camera = variant.camera(Intrinsics.from_focal(answer(PHOTO).focal, width, height))
            question = replace(question, camera=(camera.fx, camera.fy, camera.cx, camera.cy))
        return seen(ask(question), variant, width, height)

    return {
        one.name: change(answer(replace(PHOTO, camera_is_known=one.camera_is_known)), answer(one))
        for one in variants
    }
