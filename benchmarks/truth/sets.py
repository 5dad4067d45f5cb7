"""Where the photos of each data set lie, and what is known of each: one sample a photo."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.cameras import Camera

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Picture = NDArray[np.uint8]

FRAME_STEP = 5

FILMS_OF_FITS = (
    *("kv01_PKFC", "kv02_PKLP", "mu03_PKLP", "mu05_PKFC", "pu02_PKLT", "pu03_PKLT"),
    *("sv02_PKFC", "sv03_PKLP", "sv04_PKFC"),
)
"""Films of parkour on which numbers may be fitted; the others take no part in any fit."""


@dataclass(frozen=True)
class Sample:
    """One photo and its truth.

    Attributes:
        set: name of the data set.
        name: of the photo in it, fit for a file.
        group: what shares a scene: photos of one moment or one film are not independent evidence.
        source: file of the photo or film.
        frame: of a film, or None.
        crop: (x0, y0, x1, y1) px that show something, or None.
        size: width and height that the picture is stretched to, or None.
        K: (3, 3) px of the picture that the tool gets, or None if unknown.
        distortion: OpenCV's five numbers; the picture is undistorted before the tool gets it.
        truth: what was measured, per set.
    """

    set: str
    name: str
    group: str
    source: Path
    frame: int | None = None
    crop: tuple[int, int, int, int] | None = None
    size: tuple[int, int] | None = None
    K: Any = None
    distortion: Any = None
    truth: Mapping[str, Any] = field(default_factory=dict)


def picture_of(sample: Sample) -> Picture:
    """(H, W, 3) uint8 BGR, as the tool gets it."""
    import cv2

    if sample.frame is None:
        picture = cv2.imread(str(sample.source))
    else:
        film = cv2.VideoCapture(str(sample.source))
        film.set(cv2.CAP_PROP_POS_FRAMES, sample.frame)
        picture = film.read()[1]
        film.release()
    if picture is None:
        raise ValueError(
            f"{sample.source} cannot be "
            f"read{'' if sample.frame is None else f' at frame {sample.frame}'}"
        )
    if sample.crop is not None:
        x0, y0, x1, y1 = sample.crop
        picture = picture[y0:y1, x0:x1]
    if sample.size is not None:
        picture = cv2.resize(picture, sample.size, interpolation=cv2.INTER_CUBIC)
    if sample.distortion is not None and any(sample.distortion):
        picture = cv2.undistort(picture, sample.K, np.array(sample.distortion))
    pixels: Picture = np.ascontiguousarray(picture)
    return pixels


def calibrated(record: Mapping[str, Any]) -> tuple[Camera, tuple[int, int, int, int]]:
    """The camera of an entry of a ``cameras.json``, and the part (x0, y0, x1, y1) of the picture
    that shows something.

    A picture of another size than the calibrated one is that picture scaled by one factor and
    padded in the middle.
    """
    K = np.array(record.get("K", record.get("K_calibrated")), np.float64)
    width = int(record["width"])
    height = int(record["height"])
    full = (
        int(record.get("width_calibrated", width)),
        int(record.get("height_calibrated", height)),
    )
    factor = min(width / full[0], height / full[1])
    shown = [factor * side for side in full]
    left = round((width - shown[0]) / 2)
    top = round((height - shown[1]) / 2)
    # Of a warp that carries centre to centre, as the makers of the padded pictures used it.
    K[:2] *= factor
    K[:2, 2] += (width - shown[0]) / 2 - left, (height - shown[1]) / 2 - top
    width = width - 2 * left
    height = height - 2 * top
    camera = Camera(
        K, width, height, np.array(record["R"], np.float64), np.array(record["t_m"], np.float64)
    )
    return camera, (left, top, left + width, top + height)


def mpi_inf_3dhp(folder: Path) -> list[Sample]:
    """One person a photo, with K, joints, and up and a point of the floor where they are known."""
    return [
        Sample(
            "mpi_inf_3dhp",
            Path(r["image"]).stem,
            r["image"],
            folder / r["image"],
            K=np.array(r["K"]),
            truth=r,
        )
        for r in json.loads((folder / "truth.json").read_text())
    ]


def multiview(name: str, up: Sequence[float]) -> Callable[[Path], list[Sample]]:
    """Reader of a set of several calibrated cameras at several moments, floor through the origin;
    moment by moment.
    """

    def read(folder: Path) -> list[Sample]:
        samples = []
        for camera_name, record in json.loads((folder / "cameras.json").read_text())[
            "cameras"
        ].items():
            camera, shown = calibrated(record)
            whole = (0, 0, int(record["width"]), int(record["height"]))
            for photo in sorted(folder.glob(f"{camera_name}*.jpg")):
                moment = photo.stem[len(camera_name) + 1 :] or "0"
                samples.append(
                    Sample(
                        name,
                        photo.stem,
                        moment,
                        photo,
                        crop=None if shown == whole else shown,
                        K=camera.K,
                        distortion=tuple(record["dist"]),
                        truth={"camera": camera, "up": np.array(up, np.float64), "moment": moment},
                    )
                )
        return sorted(samples, key=lambda sample: (sample.group, sample.name))

    return read


def people2d(folder: Path) -> list[Sample]:
    """Boxes and keypoints of annotated people, by turns from the data sets that they come from."""
    records = json.loads((folder / "people.json").read_text())
    by_set: dict[str, list[Sample]] = {}
    for r in records:
        sample = Sample("people2d", Path(r["image"]).stem, r["image"], folder / r["image"], truth=r)
        by_set.setdefault(r["set"], []).append(sample)
    return in_turn(list(by_set.values()))


def parkour(folder: Path) -> list[Sample]:
    """Every fifth picture of each film that has a row, by turns from the films and from all over
    each of them.
    """
    from .measures import true_contact

    films = []
    for number, archive in enumerate(sorted(folder.glob("*.npz"))):
        with np.load(archive, allow_pickle=False) as data:
            arrays = {key: data[key] for key in data.files}
        touches = true_contact(arrays["forces"].astype(np.float64))
        joints = arrays["joint_names"].tolist()
        limbs = arrays["force_names"].tolist()
        film = archive.with_suffix(".mp4")
        films.append(
            [
                Sample(
                    "parkour",
                    f"{archive.stem}_{frame:03d}",
                    archive.stem,
                    film,
                    frame=frame,
                    size=(1024, 576),  # the films are 720 x 576 of 16:9
                    truth={
                        "joints": dict(
                            zip(joints, arrays["joints_m"][frame].tolist(), strict=True)
                        ),
                        "touches": dict(zip(limbs, touches[frame].tolist(), strict=True)),
                        "uncaptured": dict(
                            zip(limbs, arrays["uncaptured"][frame].tolist(), strict=True)
                        ),
                    },
                )
                for frame in rotated(scattered(range(0, frames_of(film), FRAME_STEP)), number)
            ]
        )
    return in_turn(films)


def rgbd(folder: Path) -> list[Sample]:
    """Photos with a measured depth map: image.jpg and *depth.png in millimetres, a folder each."""
    samples = []
    for photo in sorted(folder.glob("*/image.jpg")):
        for depth in sorted(photo.parent.glob("*depth.png")):
            samples.append(
                Sample(
                    "rgbd", photo.parent.name, photo.parent.name, photo, truth={"depth_file": depth}
                )
            )
    return samples


SETS: dict[str, Callable[[Path], list[Sample]]] = {
    "mpi_inf_3dhp": mpi_inf_3dhp,
    "panoptic": multiview("panoptic", (0.0, -1.0, 0.0)),
    "roundtable": multiview("roundtable", (0.0, 0.0, 1.0)),
    "people2d": people2d,
    "parkour": parkour,
    "rgbd": rgbd,
}


def frames_of(film: Path) -> int:
    """How many pictures a film has."""
    import cv2

    reader = cv2.VideoCapture(str(film))
    count = int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
    reader.release()
    return count


def in_turn(lists: Sequence[list[Sample]]) -> list[Sample]:
    """The first of each list, then the second of each, and so on: the first N are a spread over the
    lists.
    """
    return [sample for row in zip_longest(*lists) for sample in row if sample is not None]


def scattered(items: Sequence[int]) -> list[int]:
    """All items, so ordered that the first N lie all over the sequence: van der Corput's order."""
    bits = max(len(items) - 1, 1).bit_length()
    order = [int(f"{k:0{bits}b}"[::-1], 2) for k in range(1 << bits)]
    return [items[k] for k in order if k < len(items)]


def rotated(items: list[int], by: int) -> list[int]:
    """From another item on, so that the first of several films are not all of their beginnings."""
    start = by % max(len(items), 1)
    return items[start:] + items[:start]


def camera_of(sample: Sample) -> Camera:
    """The calibrated camera of a sample of a multi-view set."""
    camera: Camera = sample.truth["camera"]
    return camera
