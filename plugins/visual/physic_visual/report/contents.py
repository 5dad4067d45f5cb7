"""What the page shows of a reconstruction, ready for JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from physic_core.geometry import world_from_camera
from physic_core.types import main_people, summarize_checks, usable_text
from physic_visual.assumed_supports import assumed_supports
from physic_visual.palette import (
    CAMERA_RGB,
    CONTACT_PALETTE,
    CONTACT_RGB,
    FAINT,
    FLOOR_RGB,
    contact_color,
    contact_legend,
    has_faint_contact,
)
from physic_visual.report.people import people_records
from physic_visual.report.surfaces import (
    MAX_FULL_BODIES,
    pack_bodies,
    pack_scene,
    photo_jpeg,
)
from physic_visual.textures.dressed import GUESSED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import CheckResult, Reconstruction, StageRecord

_PHOTO_PX = 1600  # longer side of a photo in the page
_BACKGROUND_PX = 1280  # of a backdrop


def page_contents(reconstruction: Reconstruction, title: str) -> dict[str, Any]:
    """Return the data of the page.

    Lengths are metres in the camera frame; numbers that are not finite are None.
    """
    people = reconstruction.people
    contents = {
        "title": title,
        "usable": usable_text(reconstruction.usable, len(people)),
        "summary": repr(reconstruction).removeprefix("Reconstruction(").removesuffix(")"),
        "checked": summarize_checks(reconstruction.checks),
        "distance_sigma": reconstruction.distance_sigma,
        "body_model": reconstruction.body_model,
        **_photo_and_scene(reconstruction),
        **_meaning_of_colors(reconstruction),
        "bodies": pack_bodies(reconstruction),
        "assumed": [
            {"person": one.person, "name": one.name, "corners": one.vertices.ravel().tolist()}
            for one in assumed_supports(reconstruction)
        ],
        "people": people_records(reconstruction),
        "main": [i for i in main_people([one.box for one in people]) if people[i].has_body],
        "unposed": [
            {"box": one.box, "reason": one.reason}
            for one in reconstruction.unposed
            if one.is_missing
        ],
        "warnings": reconstruction.warnings,
        "notes": reconstruction.notes,
        "checks": [_check(check) for check in reconstruction.checks],
        "licenses": _licenses(reconstruction.stages),
    }
    ready: dict[str, Any] = _json_number(contents)
    return ready


def _photo_and_scene(reconstruction: Reconstruction) -> dict[str, Any]:
    camera = reconstruction.intrinsics
    scene = reconstruction.scene
    crowd = len(reconstruction.people) > MAX_FULL_BODIES
    return {
        "width": camera.width,
        "height": camera.height,
        "camera": {key: getattr(camera, key) for key in ("fx", "fy", "cx", "cy", "source")},
        "photo": photo_jpeg(reconstruction.image, _PHOTO_PX, 80 if crowd else 85),
        "background": photo_jpeg(scene.colors, _BACKGROUND_PX, 75 if crowd else 82),
        "upright": world_from_camera(scene.level).ravel().tolist(),
        "floor": scene.floor is not None,
        "scale": scene.scale,
        "scale_sigma": scene.scale_sigma,
        "scene": pack_scene(reconstruction),
    }


def _meaning_of_colors(reconstruction: Reconstruction) -> dict[str, Any]:
    return {
        "colors": {
            "contact": CONTACT_RGB,
            "floor": FLOOR_RGB,
            "camera": CAMERA_RGB,
            "assumed": CONTACT_PALETTE["something hidden"],
        },
        "legend": [
            {"label": label, "color": color}
            for label, color in contact_legend(reconstruction).items()
        ],
        "faint": FAINT if has_faint_contact(reconstruction) else "",
        "guessed": GUESSED,
        "partners": [
            {"title": one.title, "color": contact_color(one)}
            for one in reconstruction.contact_partners
        ],
    }


def _check(check: CheckResult) -> dict[str, Any]:
    return {
        "name": check.name,
        "state": str(check.state),
        "label": check.title,
        "value": check.value_text,
        "bound": check.bound_text,
        "message": "" if check.ok else check.message,
        "person": check.person,
    }


def _licenses(stages: Sequence[StageRecord]) -> list[str]:
    """Return stage and licence of the weights of each backend that states one."""
    backends = ((stage.name, stage.provenance) for stage in stages if stage.provenance is not None)
    return list(
        dict.fromkeys(
            f"{name}: {one.weights_license}" for name, one in backends if one.weights_license
        )
    )


def _json_number(value: Any) -> Any:
    """Replace numbers that are not finite by None, in lists and dictionaries."""
    if isinstance(value, dict):
        return {key: _json_number(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json_number(item) for item in value]
    if isinstance(value, str | int | None):
        return value
    number = float(value)
    return number if math.isfinite(number) else None
