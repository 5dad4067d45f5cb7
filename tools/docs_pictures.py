"""Make every picture of the documentation that shows a result, and the numbers in them, again.

    python tools/docs_pictures.py            # or: make pictures
    python tools/docs_pictures.py couple     # the pictures of one result

Results are those of the photos of examples/ in the default preset, and of worlds in the preset
``mock``. It writes ``docs/pictures``, the numbers beside them, the lines of the pages that state
them, ``examples/couple.html`` and the outputs of the notebooks. It needs Chromium for the picture
of the page.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

# pictures are of the code at hand, whatever an earlier one has kept
os.environ["PHYSIC_CACHE"] = "off"

import cv2
import docs_numbers
import numpy as np
import pages
import run_notebooks
from PIL import Image

from physic_core import Pipeline, Reconstruction, report_html
from physic_testing import load_world
from physic_visual.palette import person_color
from physic_visual.panels import colored_depth, overlay_panel, render_contact_views
from physic_visual.preview import preview_image
from physic_visual.views import build_preview_geometry, side_view, top_view

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
PAGE = ROOT / "examples" / "couple.html"

DEMO = "couple"
PHOTOS = {
    DEMO: "couple.jpg",
    "yoga": "yoga.jpg",
    "street": "street.jpg",
    "slope": "slope.jpg",
    "three-people": "three-people.jpg",
    "basketball": "basketball.png",
}
"""Files in examples/, by the names of their results."""
WORLDS = {
    "world-sofa": "sit_on_sofa",
    "world-hug": "hug",
    "world-step": "climb_step",
    "world-outdoors": "outdoor_steps",
}
WIDTH = 1280
QUALITY = 78
"""Of a preview, px, and JPEG's scale; colours of contact keep their full resolution."""
WINDOW = (1280, 760)
"""Of the browser, px."""


def draw(name: str, picture: Any, width: int = 640) -> str:
    """Write a picture at this width, and return the name of its file."""
    image = (
        picture
        if isinstance(picture, Image.Image)
        else Image.fromarray(np.asarray(picture, np.uint8))
    )
    small = image.convert("RGB").resize(
        (width, round(image.height * width / image.width)), Image.Resampling.LANCZOS
    )
    file = PICTURES / f"{name}.jpg"
    small.save(file, quality=QUALITY, subsampling=0, optimize=True, progressive=True)
    print(file.name, file.stat().st_size // 1024, "KB", flush=True)
    return file.name


def detections(estimates: Any) -> Any:
    picture = estimates.image.astype(np.float32)
    for i, mask in enumerate(estimates.photo.people.masks):
        picture[mask] = 0.5 * picture[mask] + 0.5 * np.array(person_color(i))
    picture = np.ascontiguousarray(picture.astype(np.uint8))
    keypoints = estimates.photo.keypoints
    for points, confidence in zip(keypoints.points, keypoints.confidence, strict=True):
        for x, y in points[confidence > 0.4]:
            cv2.circle(
                picture, (round(float(x)), round(float(y))), 3, (20, 20, 20), -1, cv2.LINE_AA
            )
            cv2.circle(
                picture, (round(float(x)), round(float(y))), 2, (255, 240, 90), -1, cv2.LINE_AA
            )
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


def reconstruct(name: str) -> tuple[Reconstruction, Any]:
    """Return a result by its name, and what the backends gave for it.

    Times are omitted: they are of one machine.
    """
    caught: list[Any] = []

    def keep(estimates: Any) -> Any:
        caught.append(estimates)
        return estimates

    photo = ROOT / "examples" / PHOTOS[name] if name in PHOTOS else load_world(WORLDS[name]).image
    preset = None if name in PHOTOS else "mock"
    with Pipeline(preset) as pipeline:
        result = pipeline(photo, complete=keep)
    (estimates,) = caught
    return replace(
        result, stages=tuple(replace(s, seconds=0.0, load_seconds=0.0) for s in result.stages)
    ), estimates


def draw_result(name: str) -> None:
    """Draw all pictures of a result, and write their numbers."""
    result, estimates = reconstruct(name)
    source = f"examples/{PHOTOS[name]}" if name in PHOTOS else f"world {WORLDS[name]}"
    drawn = [draw(name, preview_image(result), WIDTH)]
    if name == DEMO:
        drawn += [*draw_method(result, estimates), draw_page(result)]
    if name == "world-sofa":
        drawn += draw_stages()
    docs_numbers.write_numbers(name, source, drawn, result)


def draw_method(result: Reconstruction, estimates: Any) -> list[str]:
    """Draw the pictures of the page "How it works"."""
    overlay = overlay_panel(result, build_preview_geometry(result), 640, 480)
    scene = estimates.photo.scene_map
    return [
        draw("method-1-people", detections(estimates)),
        draw("method-2-inpainted", estimates.inpainted),
        draw("method-3-pointmap", depth(scene.points, scene.valid)),
        draw("method-4-scene", view(result, top_view)),
        draw("method-7-overlay", overlay),
        draw("method-8-contact", contact(result, 0)),
    ]


def draw_stages() -> list[str]:
    """Draw a person who sits, before and after the joint optimisation."""
    image = load_world("sit_on_sofa").image
    drawn = []
    for name, joint in {
        "method-5-placed": {"optimiser": {"steps": 1}},
        "method-6-joint": {},
    }.items():
        with Pipeline({"extends": "mock", "engine": {"joint": joint}}) as pipeline:
            drawn.append(draw(name, view(pipeline(image), side_view)))
    return drawn


def draw_page(result: Reconstruction) -> str:
    """Write the sample of ``report.html``, and a picture of it in a browser."""
    sys.path.append(str(ROOT / "tests"))
    from chromium import Chromium, find_chromium

    binary = find_chromium()
    if binary is None:
        raise SystemExit(
            "Chromium is not installed, which draws the picture of the page: apt install chromium"
        )
    PAGE.write_text(report_html(result, title=PHOTOS[DEMO]), encoding="utf-8")
    print(PAGE.name, PAGE.stat().st_size // 1024, "KB")
    browser = Chromium(binary)
    try:
        page = browser.open(PAGE.as_uri(), *WINDOW)
        page.wait("document.documentElement.dataset.ready")
        return draw("report", page.picture(), WINDOW[0])
    finally:
        browser.close()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [*PHOTOS, *WORLDS]
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"results: {', '.join(names)}; default: all, and the notebooks",
    )
    given = parser.parse_args()
    if unknown := sorted({*given.names} - {*names}):
        parser.error(f"no result is called {', '.join(unknown)}: choose of {', '.join(names)}")
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in given.names or names:
        draw_result(name)
    pages.write_pages()
    if not given.names:
        run_notebooks.run_all(check=False)


if __name__ == "__main__":
    main()
