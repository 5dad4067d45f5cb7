"""The figures of worlds, over records of people and of worlds; people of one world are one
group.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.figures import Column, contact_columns, mean_column, ratio, ratio_column

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Record = Mapping[str, Any]

BINS = 10
"""Number of bins of the reliability diagram, of equal width."""


def _counts(record: Record) -> Mapping[str, int] | None:
    return record if "hits" in record else None


def _f1(kind: str, label: str, definition: str) -> Column:
    hits, alarms, misses = (f"{kind}_{name}" for name in ("hits", "false_alarms", "misses"))
    name = f"{kind}_f1" if kind.endswith("support") else f"{kind}_contact_f1"
    return ratio_column(name, label, definition, (hits, hits), (hits, hits, alarms, misses))


def _bins(record: Record, limbs: str) -> Sequence[float] | None:
    """Return the reliability diagram (BINS * 3,) of "all", "seen" or "unseen" limbs."""
    if "reliability" not in record:
        return None
    every, unseen = (
        np.array(record[name], np.float64).ravel() for name in ("reliability", "reliability_unseen")
    )
    return tuple({"all": every, "seen": every - unseen, "unseen": unseen}[limbs])


def _calibration_error(sums: Array, first: int) -> Array:
    """Return the expected calibration error of the bins from one on: vertices, sum of
    probabilities, true contacts.
    """
    count, likely, true = np.moveaxis(
        sums.reshape(*sums.shape[:-1], BINS, 3)[..., first:, :], -1, 0
    )
    return ratio(np.abs(likely - true).sum(-1), count.sum(-1))


def _ece(key: str, label: str, definition: str, limbs: str = "all", first: int = 0) -> Column:
    return Column(
        key,
        label,
        definition,
        partial(_bins, limbs=limbs),
        partial(_calibration_error, first=first),
        3,
    )


COLUMNS: tuple[Column, ...] = (
    mean_column("found", "people found", "share of the people who have a body", 3, "high"),
    mean_column(
        "pa_mpjpe_mm", "PA-MPJPE, mm", "mean distance of 22 joints after the best similarity"
    ),
    mean_column("mpjpe_mm", "MPJPE, mm", "mean distance of 22 joints, nothing aligned", 0),
    mean_column("mpvpe_mm", "MPVPE, mm", "mean distance of all vertices, nothing aligned", 0),
    mean_column(
        "depth_error_mm", "depth of the pelvis, mm", "along z; positive where it is too far", 0, ""
    ),
    mean_column(
        "hidden_limbs_pa_mm",
        "hidden limbs PA, mm",
        "mean distance, after the similarity that fits all 22 joints best, of the knees, ankles, "
        "feet, elbows and "
        "wrists that the photo does not show: outside it, or behind objects, people or the own "
        "body",
    ),
    *contact_columns(_counts),
    mean_column(
        "geodesic_fp_cm",
        "geodesic FP, cm",
        "mean distance on the skin from predicted to true contact",
    ),
    mean_column(
        "geodesic_fn_cm",
        "geodesic FN, cm",
        "mean distance on the skin from true to predicted contact",
    ),
    ratio_column(
        "partner_accuracy",
        "partner right",
        "of the vertices that truly touch anything and are found in contact, those whose partner "
        "is right: floor; the "
        "class of the scene's surface, where it is known; the person; the part of the own body; a "
        "small object",
        ("partner_right",),
        ("partner_found",),
    ),
    _f1(
        "scene",
        "scene F1",
        "of contact with floor, scene and hidden supports; vertices of all people together",
    ),
    _f1("people", "people F1", "of contact with other people"),
    _f1("self", "self F1", "of contact with the own body"),
    ratio_column(
        "item_recall",
        "small objects found",
        "of the vertices that truly touch a small object, those in contact with something of "
        "class object",
        ("item_found",),
        ("item_found", "item_missed"),
    ),
    _f1(
        "support",
        "support F1",
        "of the body parts that carry a person; found are the parts of at least ten vertices in "
        "contact with floor, "
        "scene or a hidden support",
    ),
    _f1(
        "reported_support",
        "reported support F1",
        "of the body parts that carry a person; found are the parts of the person's support, "
        "hidden supports included; "
        "true are the parts of at least ten carrying vertices, with seat and back as parts of "
        "their own",
    ),
    ratio_column(
        "brier",
        "Brier",
        "mean square of probability of contact minus truth, over all outer vertices",
        ("brier_sum",),
        ("brier_count",),
        better="low",
    ),
    _ece(
        "ece",
        "ECE",
        f"expected calibration error over all outer vertices, in {BINS} bins of probability",
    ),
    _ece(
        "ece_likely",
        "ECE of p >= .1",
        "the same over vertices with a probability of at least one tenth",
        first=1,
    ),
    _ece(
        "ece_seen",
        "ECE of seen limbs",
        "ECE over the vertices of limbs whose end the photo truly shows",
        "seen",
    ),
    _ece("ece_unseen", "ECE of unseen limbs", "ECE over the vertices of the other limbs", "unseen"),
    mean_column(
        "penetration_mm",
        "penetration, mm",
        "mean depth, in the reconstructed scene and floor, of the vertices inside; 0 where none "
        "is, 150 mm at most; "
        "without those that an object truly hides, unless they truly touch, and those over 10 mm "
        "inside the true scene",
    ),
    mean_column("penetration_max_mm", "deepest, mm", "of the deepest of these"),
    mean_column(
        "floating_mm",
        "floating, mm",
        "mean distance, from the reconstructed scene or floor, of vertices that truly touch what "
        "the true point map or "
        "floor has within 50 mm; 0 inside, and 150 mm at most",
    ),
    mean_column(
        "floating_all_mm", "floating of all, mm", "the same of all that truly touch, shown or not"
    ),
    mean_column(
        "true_penetration_mm",
        "true penetration, mm",
        "mean depth, in the true walls, ground and furniture, of the vertices inside them, after "
        "the factor about the "
        "camera that gives the reconstructed scene its true median depth; 0 where none is, 150 mm "
        "at most, and without "
        "vertices that truly are over 10 mm inside",
    ),
    mean_column(
        "true_floating_mm",
        "true floating, mm",
        "mean distance of truly touching vertices from the true scene, after the same factor; 0 "
        "inside, at most 150 mm",
    ),
    mean_column(
        "scene_point_mm",
        "scene points, mm",
        "median distance of the scene's points from the true scene without people, pixel by pixel",
        0,
    ),
    mean_column("scene_depth_percent", "scene depth, %", "median of |Z - Z*| / Z*"),
    mean_column(
        "scene_scale_percent",
        "scale error, %",
        "|s - 1|, where s is the median depth over the true median depth",
    ),
    mean_column(
        "floor_angle_deg",
        "floor, deg",
        "between the floors' normals; none where no floor was found",
    ),
    mean_column(
        "floor_height_mm", "floor height, mm", "error of the floor's height under people's feet", 0
    ),
    mean_column("seconds", "engine, s", "of the engine", 1, ""),
)


def records_of(worlds: Sequence[Record], row: str) -> list[Record]:
    """Return a record of each person and of each world, for one table row.

    Args:
        worlds: records of :func:`physic_bench.worlds.run_worlds.run_world`.
        row: key of the table row, or "truth" for what the ground truth itself measures: it is no
            better.
    """
    found: list[Record] = []
    for world in worlds:
        title = world["name"]
        about = {"id": title, "group": title}
        if row == "truth":
            people = [person["measured"] for person in world["people"]]
        else:
            own = world["rows"][row]
            people = own["people"]
            found.append({**own["scene"], "seconds": own["seconds"], **about})
        found += [{**person, **about, "id": f"{title}, {i}"} for i, person in enumerate(people)]
    return found
