"""Draw the pictures of the documentation: ``python tools/docs_pictures.py`` writes docs/pictures/*.png.

The pages "How it works" and "Gallery" show what the default preset makes of examples/basketball.png, and what the mocks
make of synthetic worlds.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
from PIL import Image

from physic_core import Pipeline, Reconstruction
from physic_core.pipeline import estimate
from physic_core.visual.orthographic_views import side_view, top_view
from physic_core.visual.panels import colored_depth, overlay_panel, render_contact_views
from physic_core.visual.preview import preview_image
from physic_core.visual.preview_geometry import build_preview_geometry, person_color
from physic_testing import build_world

ROOT = Path(__file__).resolve().parents[1]
WORLDS = {
    "sit_on_sofa": "world-sofa",
    "hug": "world-hug",
    "climb_step": "world-step",
    "outdoor_steps": "world-outdoors",
}
COLORS = 160
"""Colours of a picture; more are not visible in renderings, and make the files three times as large."""


def write(folder: Path, name: str, picture: Any, width: int = 640) -> None:
    image = picture if isinstance(picture, Image.Image) else Image.fromarray(np.asarray(picture, np.uint8))
    height = round(image.height * width / image.width)
    small = image.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
    small.quantize(COLORS, dither=Image.Dither.NONE).save(folder / f"{name}.png", optimize=True)
    print(f"{name}.png", (folder / f"{name}.png").stat().st_size // 1024, "KB")


def detections(estimates: Any) -> Any:
    picture = estimates.image.astype(np.float32)
    for i, mask in enumerate(estimates.people.masks):
        picture[mask] = 0.5 * picture[mask] + 0.5 * np.array(person_color(i))
    picture = np.ascontiguousarray(picture.astype(np.uint8))
    for points, confidence in zip(estimates.keypoints.points, estimates.keypoints.confidence, strict=True):
        for x, y in points[confidence > 0.4]:
            cv2.circle(picture, (round(float(x)), round(float(y))), 3, (20, 20, 20), -1, cv2.LINE_AA)
            cv2.circle(picture, (round(float(x)), round(float(y))), 2, (255, 240, 90), -1, cv2.LINE_AA)
    return picture


def depth(points: Any, valid: Any) -> Any:
    z = np.where(valid, points[..., 2], np.nan)
    near, far = np.nanpercentile(z, [1, 99])
    picture = colored_depth(np.nan_to_num(z, nan=far).astype(np.float32), float(near), float(far))
    picture[~valid] = 190
    return picture


def view(result: Reconstruction, which: Any) -> Any:
    return which(build_preview_geometry(result), 640, 480).picture


def contact(result: Reconstruction, index: int) -> Any:
    return render_contact_views(result, index, 800, 480)


def method(folder: Path) -> None:
    caught: list[Any] = []

    def keep(*args: Any, **settings: Any) -> Any:
        caught.append(real(*args, **settings))
        return caught[-1]

    real = estimate.run_backends

    with mock.patch.object(estimate, "run_backends", keep), Pipeline() as pipeline:
        result = pipeline(ROOT / "examples" / "basketball.png")
    (estimates,) = caught
    write(folder, "method-1-people", detections(estimates))
    write(folder, "method-2-inpainted", estimates.inpainted)
    write(folder, "method-3-pointmap", depth(estimates.scene.points, estimates.scene.valid))
    write(folder, "method-4-scene", view(result, top_view))
    write(folder, "method-7-overlay", overlay_panel(result, build_preview_geometry(result), 640, 480))
    write(folder, "method-8-contact", contact(result, 0))
    write(folder, "gallery-basketball", preview_image(result), 1200)


def stages(folder: Path) -> None:
    """A person who sits, before and after the joint optimisation."""
    image = build_world("sit_on_sofa").image
    for name, steps in {"method-5-placed": 1, "method-6-joint": None}.items():
        joint = {} if steps is None else {"engine": {"joint": {"optimiser": {"steps": steps}}}}
        with Pipeline({"extends": "mock", **joint}) as pipeline:
            write(folder, name, view(pipeline(image), side_view))


def gallery(folder: Path) -> None:
    with Pipeline("mock") as pipeline:
        for world, name in WORLDS.items():
            write(folder, f"gallery-{name}", preview_image(pipeline(build_world(world).image)), 1200)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "pictures"
    target.mkdir(parents=True, exist_ok=True)
    method(target)
    stages(target)
    gallery(target)
