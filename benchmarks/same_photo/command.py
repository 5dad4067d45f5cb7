"""Measure how much the answer to a photo changes when the photo is mirrored, scaled, cropped,
compressed or grey.

    python -m benchmarks same_photo DATA OUT [--variants mirror,scale] [--photos N] [--half
    development]

Photos are drawn from the labelled ones of ``benchmarks.contact_on_photos`` with at most four
people. Those of half "development" serve to choose between versions of the code, those of half
"held" to report them. "K" is a camera that is given: that of the photo's own result, and for a crop
that camera shifted.

OUT/answers keeps what is compared of each result; an interrupted run continues. After a change of
the code give another OUT, and ``--cache OUT/cache`` of the earlier run: it keeps the outputs of the
networks. A row is a variant, a pair of numbers the median and the 90th percentile; three numbers
are the median, the 90th and the 95th percentile.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import pickle
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.contact_on_photos import samples_of
from benchmarks.fits import HALVES, half_of, parser_of
from benchmarks.truth.builds import keep_networks_only
from benchmarks.truth.sets import Sample, picture_of
from physic_testing.metrics import markdown_table

from .changes import Change, change, table
from .variants import PHOTO, PHOTO_K, VARIANTS, Answer, Picture, Variant, answer_of, no_answer

if TYPE_CHECKING:
    from physic_core import Pipeline

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
    cache = given.cache or given.out / "cache"
    os.environ["PHYSIC_CACHE"] = str(cache.resolve())
    changes: dict[str, list[Change]] = {variant.name: [] for variant in variants}
    with embedded_pipeline(given.set) as pipeline:
        for number, sample in enumerate(samples, 1):
            folder = given.out / "answers" / sample.name
            found = changes_of(picture_of(sample)[..., ::-1], variants, folder, pipeline)
            for name, one in found.items():
                changes[name].append(one)
            keep_networks_only(cache)
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
    add("--cache", type=Path, help="folder of the networks' outputs; OUT/cache if not given")
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


def embedded_pipeline(overrides: Sequence[str] = ()) -> Pipeline:
    """Return the pipeline of preset "embedded" with a cache for the outputs of networks on many
    photos.
    """
    from physic_core import Pipeline, load_config

    return Pipeline(load_config(preset="embedded", overrides=["run.cache_mb=100000", *overrides]))


def changes_of(
    picture: Picture, variants: Sequence[Variant], folder: Path, pipeline: Pipeline
) -> dict[str, Change]:
    """Return the change by each variant of a photo (H, W, 3) RGB; run those of which the folder has
    no answer.
    """
    folder.mkdir(parents=True, exist_ok=True)
    changes = {}
    for variant in variants:
        photo = kept_answer(
            picture, PHOTO_K if variant.camera_is_known else PHOTO, folder, pipeline
        )
        changes[variant.name] = change(photo, kept_answer(picture, variant, folder, pipeline))
    return changes


def kept_answer(picture: Picture, variant: Variant, folder: Path, pipeline: Pipeline) -> Answer:
    """Return the answer to a variant of a photo (H, W, 3) RGB, from the file of an earlier run if
    there is one.
    """
    from physic_core import Intrinsics
    from physic_core.errors import PhysicError
    from physic_core.types import CameraTrust

    path = folder / f"{variant.name}.pickle"
    if path.is_file():
        found: Answer = pickle.loads(path.read_bytes())
        return found
    height, width = picture.shape[:2]
    camera = None
    if variant.camera_is_known:
        focal = kept_answer(picture, PHOTO, folder, pipeline).focal
        camera = variant.camera(
            Intrinsics.from_focal(focal, width, height, trust=CameraTrust.KNOWN)
        )
    try:
        found = answer_of(
            pipeline(variant.picture(picture), intrinsics=camera), variant, width, height
        )
    except PhysicError as error:
        print(f"{folder.name}, {variant.name}: {error}", file=sys.stderr)
        found = no_answer(variant, width, height)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_bytes(pickle.dumps(found))
    part.replace(path)
    return found
