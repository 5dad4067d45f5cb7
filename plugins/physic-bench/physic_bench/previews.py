"""Previews of the frames with the largest errors: the picture with true and predicted bodies drawn over it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.joints import LIMB_JOINTS
from physic_bench.pictures import read_picture
from physic_bench.projection import project
from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.contract import Frame, PredictedPerson, TruePerson
    from physic_bench.evaluation import Evaluation, Method

    Array = NDArray[np.float64]
    Pixels = NDArray[np.uint8]

WORST = 10
WIDTH = 960
TRUE, PREDICTED = (40, 200, 90), (235, 80, 40)
LINES = (
    *(
        (f"{side}_{first}", f"{side}_{second}")
        for side in ("left", "right")
        for first, second in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
    ),
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("left_shoulder", "left_hip"),
    ("right_shoulder", "right_hip"),
)


def write_previews(evaluation: Evaluation, folder: Path) -> list[Path]:
    """Write a picture of each of the ten worst frames of each method, worst first.

    People without a body come first, then the largest MPJPE, or MPVPE without joints.
    """
    from physic_core.files.atomic import MARK, atomic_write, check_writable

    frames = {frame.id: frame for frame in evaluation.frames}
    written = []
    for method in evaluation.methods:
        worst: dict[str, float] = {}
        for record in evaluation.records:
            if record["method"] == method.name:
                error = record.get("me_mpjpe", record.get("me_pve")) if record["found"] else np.inf
                if error is not None and not np.isnan(error):
                    worst[record["frame"]] = max(worst.get(record["frame"], 0.0), float(error))
        chosen = sorted(worst, key=lambda name: -worst[name])[:WORST]
        own = check_writable(folder / method.name.replace("/", "_")) if chosen else folder
        for rank, name in enumerate(chosen, 1):
            error = "no body" if np.isinf(worst[name]) else f"{worst[name]:.0f} mm"
            page = _drawn(frames[name], method, f"{rank}. {name}: {error}")
            path = own / f"{rank:02d}-{name.replace('/', '_')}.jpg"
            with atomic_write(own) as temporary:
                page.save(temporary(path.name), format="JPEG", quality=85, comment=MARK)
            written.append(path)
    return written


def _drawn(frame: Frame, method: Method, title: str) -> Any:
    from PIL import Image, ImageDraw

    camera = frame.camera
    scale = WIDTH / camera.width
    page = Image.fromarray(_background(frame)).resize((WIDTH, round(camera.height * scale)))
    pen = ImageDraw.Draw(page)
    for person in frame.truth().people:
        _draw(pen, person, camera.K, scale, TRUE)
    prediction = method.result_or_none(frame)
    for found in () if prediction is None else prediction.people:
        # With the true camera: what the error is in the picture.
        _draw(pen, found, camera.K, scale, PREDICTED)
    pen.text((8, 6), f"{title}\ngreen: truth, red: {method.name}", fill=(255, 255, 255), stroke_width=2, stroke_fill=0)
    return page


def _background(frame: Frame) -> Pixels:
    camera = frame.camera
    blank = np.full((camera.height, camera.width, 3), 60, np.uint8)
    if frame.picture is None:
        return blank
    try:
        pixels = read_picture(frame.picture)
    except InputError:
        return blank
    if not any(camera.distortion):
        return pixels
    from physic_bench.cameras import undistorted

    return undistorted(pixels, camera.K, np.array(camera.distortion))


def _draw(pen: Any, person: TruePerson | PredictedPerson, K: Array, scale: float, color: tuple[int, int, int]) -> None:
    """Draw a skeleton of limbs if there are joints, and some vertices."""
    if person.vertices is not None:
        pixels = scale * project(np.asarray(person.vertices[:: max(len(person.vertices) // 1500, 1)], np.float64), K)
        pen.point([(float(x), float(y)) for x, y in pixels[np.isfinite(pixels).all(-1)]], fill=color)
    if person.joints is None:
        return
    pixels = scale * project(np.asarray(person.joints, np.float64), K)
    place = {
        n: (float(x), float(y)) for n, (x, y) in zip(person.joint_names, pixels, strict=True) if np.isfinite(x + y)
    }
    for first, second in LINES:
        if first in place and second in place:
            pen.line([place[first], place[second]], fill=color, width=3)
    for name in LIMB_JOINTS:
        if name in place:
            x, y = place[name]
            pen.ellipse([x - 3, y - 3, x + 3, y + 3], fill=color)
