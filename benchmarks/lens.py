"""How good the focal length of straight edges is, on photos whose lens is known, and whether variants of a photo agree.

    python -m benchmarks.lens DATA [--photos 30] [--sets mpi_inf_3dhp,panoptic,roundtable,exif]

DATA has the data sets of ``benchmarks.truth``. A folder ``exif`` may hold photos as a camera wrote them. Each photo of
known lens is taken whole and as central crops of .9 to .5 of it, so that a default cannot be right for all. The first
table scores the answer against the default alone; its intervals are 95 % over moments and photos. The second compares
photos of ``photos`` and ``contact`` with themselves mirrored, scaled by .9, and without one column. Only the network of
line segments runs, on whole photos, people included.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physic_core.adapters.onnx_sessions import OnnxSession
from physic_core.io.photo import limit_size, read_photo
from physic_embedded.networks.line_segments import detect_line_segments
from physic_embedded.networks.sessions import open_packaged_session
from physic_embedded.relative_pointmap import EmbeddedPointmapOptions
from physic_embedded.single_view.focal import DEFAULT_FOCAL_SIGMA, focal_of_segments

from .truth.sets import SETS, picture_of
from .truth.statistics import Record, figure, pooled

Picture = NDArray[np.uint8]

CROPS = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
KNOWN = ("mpi_inf_3dhp", "panoptic", "roundtable")
DEFAULT = (float(np.log(EmbeddedPointmapOptions().default_focal)), DEFAULT_FOCAL_SIGMA)
"""Logarithm of the default focal length in long sides, and its standard deviation."""


def main() -> int:
    """Measure and print both tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lens", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--sets", default=",".join((*KNOWN, "exif")), help="of known lenses, with commas between them")
    parser.add_argument("--photos", type=int, default=30, help="that are compared with their variants")
    given = parser.parse_args()
    session = open_packaged_session("mlsd_large_512", 1, "cpu")
    print(f"{'set':14}{'crops':>6}  {'log score above the default':30}{'error / sigma':>14}{'error':>8}{'default':>9}")
    every: list[Record] = []
    for name in given.sets.split(","):
        records = [record_of(session, name, *known) for known in known_lenses(given.data, name)]
        every += records
        if records:
            print(row(name, records), flush=True)
    if every:
        print(row("all", every))
    paths = sorted(p for folder in ("photos", "contact/photos") for p in (given.data / folder).glob("*.jp*g"))
    chosen = np.random.default_rng(0).permutation(len(paths))[: given.photos]
    pictures = [limit_size(read_photo(paths[i]), 1280).image for i in sorted(chosen)]
    print(f"\n{len(pictures)} photos    {'change, median':>16}{'90 %':>8}{'change / sigma, 95 %':>24}")
    for name, changes in variant_changes(session, pictures).items():
        size, over = np.abs(changes).T
        print(
            f"{name:14}{np.median(size):12.1%}{np.percentile(size, 90):8.1%}{np.percentile(over, 95):24.2f}", flush=True
        )
    return 0


def known_lenses(data: Path, name: str) -> Iterator[tuple[str, str, float, Picture, float]]:
    """Yield group, photo, focal length in px, a picture about its principal point, and its share of the photo's."""
    for group, photo, focal, (cx, cy), picture in known_photos(data, name):
        for share in CROPS:
            width, height = (round(share * side) for side in picture.shape[1::-1])
            x = round(np.clip(cx - (width - 1) / 2, 0, picture.shape[1] - width))
            y = round(np.clip(cy - (height - 1) / 2, 0, picture.shape[0] - height))
            yield group, photo, focal, np.ascontiguousarray(picture[y : y + height, x : x + width]), share


def known_photos(data: Path, name: str) -> Iterator[tuple[str, str, float, tuple[float, float], Picture]]:
    """Yield group, name, focal length, principal point and RGB picture of each photo of a set."""
    if name == "exif":
        for path in sorted((data / name).glob("*.jp*g")):
            photo = limit_size(read_photo(path), 1280)
            if (camera := photo.intrinsics) is not None:
                yield path.stem, path.stem, camera.fx, (camera.cx, camera.cy), photo.image
    elif (data / "truth" / name).is_dir():
        for sample in SETS[name](data / "truth" / name):
            K = sample.K
            picture = cv2.cvtColor(picture_of(sample), cv2.COLOR_BGR2RGB)
            yield sample.group, sample.name, float(np.sqrt(K[0, 0] * K[1, 1])), (K[0, 2], K[1, 2]), picture


def record_of(
    session: OnnxSession, name: str, group: str, photo: str, focal_px: float, picture: Picture, share: float
) -> Record:
    """Return the error of a picture's focal length, and its score above that of the default."""
    truth = float(np.log(focal_px / max(picture.shape)))
    mean, sigma = focal_of(session, picture)
    score, default = (-(((truth - m) / s) ** 2) / 2 - np.log(s) for m, s in ((mean, sigma), DEFAULT))
    errors = {
        "square": (mean - truth) ** 2,
        "over": ((mean - truth) / sigma) ** 2,
        "default": (DEFAULT[0] - truth) ** 2,
    }
    return {"set": name, "group": group, "photo": photo, "share": share, "gain": float(score - default), **errors}


def focal_of(session: OnnxSession, picture: Picture) -> tuple[float, float]:
    """Return the logarithm of the focal length in long sides, and its standard deviation."""
    height, width = picture.shape[:2]
    side = max(height, width)
    segments = detect_line_segments(session, picture)
    found = focal_of_segments(segments, width, height, float(np.exp(DEFAULT[0])) * side, DEFAULT[1])
    return DEFAULT if found is None else (float(np.log(found[0] / side)), found[1])


def row(name: str, records: Sequence[Record]) -> str:
    """Return a row of the first table."""

    def rms(key: str) -> float:
        return float(np.sqrt(np.mean([record[key] for record in records])))

    gain = figure(records, pooled("gain"))
    score = f"{gain.value:+.3f}  [{gain.low:+.3f}, {gain.high:+.3f}]"
    return f"{name:14}{len(records):6}  {score:30}{rms('over'):14.2f}{rms('square'):8.3f}{rms('default'):9.3f}"


def variant_changes(session: OnnxSession, pictures: Sequence[Picture]) -> dict[str, NDArray[np.float64]]:
    """Return the change of log focal length in px of the photo, and the same over the smaller sigma, (N, 2)."""
    variants = {
        "mirrored": lambda p: (p[:, ::-1], 1.0),
        "scaled by .9": lambda p: (cv2.resize(p, None, fx=0.9, fy=0.9, interpolation=cv2.INTER_AREA), 0.9),
        "one column less": lambda p: (p[:, 1:], 1.0),
    }
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in variants}
    for picture in pictures:
        mean, sigma = focal_of(session, picture)
        for name, vary in variants.items():
            varied, scale = vary(picture)
            other, other_sigma = focal_of(session, np.ascontiguousarray(varied))
            change = other + np.log(max(varied.shape) / scale) - mean - np.log(max(picture.shape))
            found[name].append((float(change), float(change / min(sigma, other_sigma))))
    return {name: np.array(changes) for name, changes in found.items()}


if __name__ == "__main__":
    sys.exit(main())
