"""Published networks through physic-onnx beside the packaged ones of physic-embedded, on photos.

    python tools/fetch_published.py FOLDER
    PHYSIC_WEIGHTS=FOLDER python tools/compare_published.py OUT photo.jpg ...

SAM 2 is shown the boxes that physic-embedded found, both inpainters the same mask. OUT gets a picture a photo: masks
and floor of SAM 2, of physic-embedded; the photo without its people by MI-GAN's pipeline, by physic-embedded.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from physic_core.adapters.detections import Detections
from physic_core.types import People
from physic_core.weights import locate
from physic_embedded.inpainter import MiGan as EmbeddedMiGan
from physic_embedded.segmenter import EmbeddedSegmenter
from physic_onnx.migan import MiGan, MiGanOptions
from physic_onnx.sam2 import MANIFEST, Sam2, Sam2Options
from physic_onnx.sam2_networks import open_sam2


class Told:
    """Stands for a detector that saw given boxes."""

    def __init__(self, people: People) -> None:
        order = np.argsort(-people.scores, kind="stable")
        self.found = Detections(people.boxes[order].astype(float), people.scores[order].astype(float))

    def infer(self, image: np.ndarray, score: float, overlap: float) -> Detections:
        return self.found


def compare(path: Path, out: Path) -> str:
    """One row of the table, and one picture."""
    photo = np.array(Image.open(path).convert("RGB"))
    embedded = EmbeddedSegmenter()
    embedded.load()
    theirs = embedded.infer(photo)
    sam2 = Sam2(Sam2Options(weights="sam2-hiera-tiny"))
    sam2._networks = open_sam2(locate(MANIFEST, "sam2-hiera-tiny"), sam2.options, "cpu")
    sam2._detector = Told(theirs)
    started = time.perf_counter()
    ours = sam2.infer(photo)
    seconds = time.perf_counter() - started
    iou = [max((overlap(mask, own) for own in ours.masks), default=0.0) for mask in theirs.masks]
    floor = "-" if ours.floor is None or theirs.floor is None else f"{overlap(ours.floor, theirs.floor):.2f}"
    row = f"{path.name} | {len(theirs)} | {' '.join(f'{v:.3f}' for v in iou)} | {floor} | {seconds:.1f}"
    pictures = [painted(photo, ours), painted(photo, theirs)]
    if len(ours):
        radius = max(1, round(0.008 * max(photo.shape)))
        brush = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        hole = cv2.dilate(ours.masks.any(axis=0).astype(np.uint8), brush) > 0
        filled = []
        for backend in (MiGan(MiGanOptions()), EmbeddedMiGan()):
            backend.load()
            started = time.perf_counter()
            filled.append(backend.infer(photo, hole))
            row += f" | {time.perf_counter() - started:.1f}"
        apart = np.abs(filled[0].astype(int) - filled[1])
        ratio = detail(filled[0], hole) / detail(filled[1], hole)
        row += f" | {apart[hole].mean():.1f} | {apart[~hole].max()} | {ratio:.2f}"
        pictures += filled
    height = 480
    shown = [Image.fromarray(p).resize((round(p.shape[1] * height / p.shape[0]), height)) for p in pictures]
    sheet = Image.new("RGB", (sum(p.width for p in shown), height))
    for i, picture in enumerate(shown):
        sheet.paste(picture, (sum(p.width for p in shown[:i]), 0))
    sheet.save(out / f"{path.stem}.png")
    return row


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of masks."""
    return float((a & b).sum() / max(1, (a | b).sum()))


def detail(photo: np.ndarray, hole: np.ndarray) -> float:
    """Mean size of the second derivative inside the hole, away from its edge."""
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY).astype(np.float32)
    inside = cv2.erode(hole.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    return float(np.abs(cv2.Laplacian(grey, cv2.CV_32F))[inside].mean())


def painted(photo: np.ndarray, people: People) -> np.ndarray:
    """The photo with people in colours and the floor in green."""
    picture, rng = photo.astype(float), np.random.default_rng(1)
    for mask in people.masks:
        picture[mask] = 0.5 * picture[mask] + 0.5 * rng.integers(0, 255, 3)
    if people.floor is not None:
        picture[people.floor] = 0.6 * picture[people.floor] + 0.4 * np.array([0, 255, 0])
    return picture.astype(np.uint8)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path, help="folder for the pictures")
    parser.add_argument("photos", type=Path, nargs="+")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    print(
        "photo | people | IoU of masks | IoU of floors | SAM 2 s | MI-GAN s | embedded s | "
        "apart in the hole, grey levels | apart elsewhere | detail in the hole, ratio"
    )
    for photo in arguments.photos:
        print(compare(photo, arguments.out), flush=True)
