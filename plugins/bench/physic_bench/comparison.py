"""Compare two results of one photo person by person, and two folders of results photo by photo;
tables and a page.
"""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from physic_batch.contact_sheet import fill_page, find_results
from physic_batch.photo_processor import WITHOUT_EFFECT
from physic_core.body import JOINT_NAMES
from physic_core.errors import InputError
from physic_core.io.result_folder import is_result, photo_identity_of_result
from physic_core.types import (
    MARKS,
    Person,
    is_usable,
    marks_text,
    part_words,
    pelvis_distance_m,
    usable_text,
)
from physic_testing.metrics import BODY_JOINTS, match_by_masks
from physic_visual.palette import contact_label

if TYPE_CHECKING:
    from physic_core.types import BoolArray, ContactPartner, FloatArray, Reconstruction

HEAD = (
    "photo, person",
    "usable in A",
    "usable in B",
    "distance A",
    "distance B",
    "joints",
    "pose",
    "contact that differs",
)

TRUST_NOISE = 0.06
"""Change of a probability that says nothing: the largest median by which the same photo, mirrored,
grey or scaled, moves it (docs/checks.md).
"""

Marks: TypeAlias = Mapping[str, float | None]
"""Name -> probability that it is right."""

PICTURE_HEIGHT = 320
"""Height of the pictures on the page, px."""


@dataclass(frozen=True)
class JointDifference:
    """Distances of the same joints of two bodies, of the 22 joints from pelvis to wrists.

    Attributes:
        mean_m: of all.
        worst: name of the joint with the largest one.
        worst_m: the largest one.
    """

    mean_m: float
    worst: str
    worst_m: float

    def __str__(self) -> str:
        return (
            f"{1000 * self.mean_m:.0f} mm ({self.worst.replace('_', ' ')} "
            f"{1000 * self.worst_m:.0f} mm)"
        )


@dataclass(frozen=True)
class PersonPair:
    """One person of two results A and B; pairs of values are in this order, None where a result has
    none.

    Attributes:
        index: of the person in each result; None in the one that has no such person.
        marks: probability that each is right, by name.
        distance_m: of the pelvis from the camera.
        joints: how far the joints are apart; None without two bodies.
        pose: the same with both pelvises in one place.
        contacts: likely contacts of each, such as "left hand: floor".
        from_given_m: how far the pelvis, and in the mean the other joints relative to it, are from
            those of the body that the user gave; None for an estimated one.
    """

    index: tuple[int | None, int | None]
    marks: tuple[Marks | None, Marks | None]
    distance_m: tuple[float | None, float | None]
    joints: JointDifference | None
    pose: JointDifference | None
    contacts: tuple[tuple[str, ...], tuple[str, ...]]
    from_given_m: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None)


@dataclass(frozen=True)
class Comparison:
    """Two results A and B of one photo.

    Attributes:
        photo: name of the photo, or of the folder of A if that is not known.
        changed: backends, settings and versions that differ, such as "inpainter: embedded ->
            telea", after a sentence about photos that differ.
        usable: for how many people of each result the marks are usable, in words.
        focal_px: focal length of each camera.
        depth_m: median depth of each scene, over the pixels that both know; None without such
            pixels.
        depth_difference: median of the relative difference of depth of one pixel.
        people: those of A, then those that only B has.
    """

    photo: str
    changed: tuple[str, ...]
    usable: tuple[str, str]
    focal_px: tuple[float, float]
    depth_m: tuple[float | None, float | None]
    depth_difference: float | None
    people: tuple[PersonPair, ...]


def pair_results(a: Path, b: Path) -> tuple[list[tuple[Path, Path]], tuple[list[Path], list[Path]]]:
    """Return the pairs of results of one photo in A and B, by the digests of the photos, and the
    results only in A and only in B.

    Two results of one photo each are one pair.

    Args:
        a: folder of a result, or of a batch, or of results.
        b: the same.

    Raises:
        InputError: a folder has no result.
    """
    if is_result(a) and is_result(b):
        return [(a, b)], ([], [])
    in_a, in_b = _by_photo(a), _by_photo(b)
    both = [(folder, in_b[key]) for key, folder in in_a.items() if key in in_b]
    only_a = [folder for key, folder in in_a.items() if key not in in_b]
    only_b = [folder for key, folder in in_b.items() if key not in in_a]
    return both, (only_a, only_b)


def compare_results(a: Reconstruction, b: Reconstruction, name: str = "") -> Comparison:
    """Compare two results of one photo; people are matched by their masks.

    Args:
        a: the first result.
        b: the second one.
        name: for a photo whose name the results do not state.

    Raises:
        InputError: the pictures have different sizes.
    """
    sizes = [f"{one.intrinsics.width} x {one.intrinsics.height}" for one in (a, b)]
    if sizes[0] != sizes[1]:
        raise InputError(
            f"the results are of {sizes[0]} and {sizes[1]} px: compare two results of one photo"
        )
    matching = match_by_masks(_people_masks(b), _people_masks(a))
    partner = matching.predicted_of
    pairs = [_pair(a, b, index, partner.get(index)) for index in range(len(a.people))]
    added = [_pair(a, b, None, int(index)) for index in matching.false_alarms]
    depths = [one.scene.points[a.scene.valid & b.scene.valid, 2] for one in (a, b)]
    return Comparison(
        photo=a.photo_name or b.photo_name or name,
        changed=_changes(a, b),
        usable=(_usable_text(a), _usable_text(b)),
        focal_px=(a.intrinsics.fx, b.intrinsics.fx),
        depth_m=(_median_depth(depths[0]), _median_depth(depths[1])),
        depth_difference=_median_depth(np.abs(np.subtract(*depths, dtype=np.float64)) / depths[0]),
        people=(*pairs, *added),
    )


def table_rows(photo: Comparison) -> list[tuple[str, ...]]:
    """Return the rows of a photo, with the columns of :data:`HEAD`: its people, the median depth of
    its scene, and one of each person.
    """
    rows = [
        (photo.photo, *photo.usable, "", "", "", "", ""),
        ("  median depth of the scene", "", "", *map(_metres_text, photo.depth_m), "", "", ""),
    ]
    for person in photo.people:
        joints = ["-" if one is None else str(one) for one in (person.joints, person.pose)]
        counts = [
            ", ".join(sorted(set(one) - set(other)))
            for one, other in (person.contacts, person.contacts[::-1])
        ]
        contact = "; ".join(
            f"only {name}: {text}" for name, text in zip("AB", counts, strict=True) if text
        )
        distances = map(_metres_text, person.distance_m)
        rows.append(
            (f"  {_person_title(person)}", *_mark_texts(person.marks), *distances, *joints, contact)
        )
    return rows


def changed_lines(photos: Sequence[Comparison]) -> list[str]:
    """Return the backends, settings and versions that differ, and in how many photos if not in
    all.
    """
    if not photos:
        return ["no photo is in both"]
    counts = Counter(text for photo in photos for text in photo.changed)
    of_some = {
        text: f" ({count} of {len(photos)} photos)"
        for text, count in counts.items()
        if count < len(photos)
    }
    return [text + of_some.get(text, "") for text in counts] or [
        "no setting: A and B have the same"
    ]


def summary_lines(
    photos: Sequence[Comparison], only: tuple[Sequence[Path], Sequence[Path]]
) -> list[str]:
    """Return sentences about all photos, and about the photos with a result in only one folder."""
    people = [person for photo in photos for person in photo.people]
    pairs = [person for person in people if None not in person.index]
    joints = [person.joints.mean_m for person in pairs if person.joints is not None]
    poses = [person.pose.mean_m for person in pairs if person.pose is not None]
    ratios = [b / a for a, b in (photo.depth_m for photo in photos) if a and b]
    lines = [
        f"people in both: {len(pairs)}; only in A: "
        f"{sum(person.index[1] is None for person in people)}; "
        f"only in B: {sum(person.index[0] is None for person in people)}"
    ]
    steps = Counter(step for person in pairs for _, step in _mark_changes(person.marks))
    if steps:
        lines.append(
            "marks of people in B: "
            + ", ".join(
                f"{steps[step]} {step}" for step in ("better", "worse", "the same") if steps[step]
            )
        )
    if joints:
        lines.append(
            f"medians of people: joints {1000 * median(joints):.0f} mm, pose "
            f"{1000 * median(poses):.0f} mm"
        )
    for i, name in enumerate("AB"):
        changes = [moved for person in people if (moved := person.from_given_m[i]) is not None]
        if changes:
            distance_mm, pose = (1000 * value for value in np.median(changes, axis=0))
            lines.append(
                f"given bodies of {len(changes)} people in {name}: medians of the engine's change "
                f"of place {distance_mm:.0f} mm, of pose {pose:.0f} mm"
            )
    if ratios:
        lines.append(f"median of scenes: the depth of B is {median(ratios):.2f} times that of A")
    for name, folders in zip("AB", only, strict=True):
        lines += [f"only in {name}: {folder.name}" for folder in folders]
    return lines


def comparison_page(
    photos: Sequence[Comparison],
    pictures: Sequence[Sequence[bytes]],
    links: Sequence[Sequence[str]],
    warnings: Sequence[tuple[str, Sequence[str]]],
) -> str:
    """Return the page.

    Args:
        photos: all comparisons.
        pictures: thumbnails of A and B of each, :data:`PICTURE_HEIGHT` px high.
        links: to the pages of both results of each; "" where there is none.
        warnings: title and lines of what stands above the photos.
    """
    cards = [
        {
            "title": photo.photo,
            "pictures": [base64.b64encode(picture).decode() for picture in pair],
            "links": two,
            "sections": list(_sections(photo)),
        }
        for photo, pair, two in zip(photos, pictures, links, strict=True)
    ]
    page = files("physic_bench") / "comparison.html"
    return fill_page(page, DATA={"about": warnings, "photos": cards})


def _by_photo(folder: Path) -> dict[tuple[str, int], Path]:
    """Return the results below a folder by digest of the photo, sorted by their names; equal photos
    are numbered.
    """
    counts = Counter[str]()
    result_of = {}
    for result in sorted(find_results(folder), key=lambda one: one.name):
        photo = photo_identity_of_result(result) or str(result.relative_to(folder))
        result_of[photo, counts[photo]] = result
        counts[photo] += 1
    return result_of


def _people_masks(result: Reconstruction) -> BoolArray:
    none = np.zeros((0, *result.image.shape[:2]), bool)
    return np.concatenate([none, *(person.mask[None] for person in result.people)])


def _pair(
    a: Reconstruction, b: Reconstruction, first: int | None, second: int | None
) -> PersonPair:
    person = None if first is None else a.people[first]
    other_person = None if second is None else b.people[second]
    joints = pose = None
    if person is not None and other_person is not None:
        joints = _difference(person.joints, other_person.joints)
        pose = _difference(
            person.joints - person.joints[:1], other_person.joints - other_person.joints[:1]
        )
    return PersonPair(
        index=(first, second),
        marks=(
            None if person is None else person.marks,
            None if other_person is None else other_person.marks,
        ),
        distance_m=(
            None if person is None else pelvis_distance_m(person),
            None if other_person is None else pelvis_distance_m(other_person),
        ),
        joints=joints,
        pose=pose,
        contacts=(_contact_texts(person), _contact_texts(other_person)),
        from_given_m=(_from_given(person), _from_given(other_person)),
    )


def _from_given(person: Person | None) -> tuple[float, float] | None:
    """Return how far a body was moved from the given one, and its pose changed, metres."""
    if person is None or person.given_joints is None or not person.has_body:
        return None
    moved = (person.joints - person.given_joints)[BODY_JOINTS]
    pose = np.linalg.norm(moved[1:] - moved[0], axis=-1).mean()
    return float(np.linalg.norm(moved[0])), float(pose)


def _contact_texts(person: Person | None) -> tuple[str, ...]:
    """Return likely contacts as "part: what it touches"."""
    likely = [] if person is None else [one for one in person.contacts if one.likely]
    texts = [
        f"{part_words(c.part)}: {_touched(c.partner)}{' (assumed: hidden)' if c.assumed else ''}"
        for c in likely
    ]
    return tuple(dict.fromkeys(texts))


def _touched(partner: ContactPartner) -> str:
    """Return the title of a partner, without the numbers of surfaces and people, which differ
    between results.
    """
    return partner.title if partner.surface or partner.kind == "hidden" else contact_label(partner)


def _difference(first: FloatArray, second: FloatArray) -> JointDifference | None:
    apart = np.linalg.norm(
        np.asarray(first[BODY_JOINTS], np.float64) - second[BODY_JOINTS], axis=-1
    )
    if not len(apart) or not np.isfinite(apart).all():
        return None
    return JointDifference(
        float(apart.mean()), JOINT_NAMES[int(apart.argmax())], float(apart.max())
    )


def _changes(a: Reconstruction, b: Reconstruction) -> tuple[str, ...]:
    """Return what differs in the photos and configurations of two results, and in the versions of
    their plugins.
    """
    one, other_settings = (_settings(result) for result in (a, b))
    names = [
        name
        for name in dict.fromkeys((*one, *other_settings))
        if one.get(name) != other_settings.get(name)
    ]
    # another backend has other options
    backends = tuple(f"{name}.options." for name in names if "." not in name)
    changed = {
        name: (one.get(name, "default"), other_settings.get(name, "default"))
        for name in names
        if not name.startswith(backends)
    }
    old, new = (
        {
            stage.provenance.distribution: stage.provenance.version
            for stage in result.stages
            if stage.provenance
        }
        for result in (a, b)
    )
    changed |= {
        name: (old[name], new[name]) for name in old.keys() & new.keys() if old[name] != new[name]
    }
    settings = tuple(
        f"{name}: {' -> '.join(_setting_texts(name, values))}" for name, values in changed.items()
    )
    # of digest: of the file, or of the pixels
    kinds = {one.photo.partition(":")[0] for one in (a, b)}
    if a.photo == b.photo or len(kinds) > 1:
        return settings
    both = f"{a.photo_name or 'that of A'} and {b.photo_name or 'that of B'}"
    return (
        f"the photo: {both} differ, so the comparison is valid only if both "
        f"show the same scene from the same place",
        *settings,
    )


def _settings(result: Reconstruction) -> dict[str, Any]:
    """Return the settings of a result that have an effect, by dotted names; a backend has that of
    its interface.
    """
    flat: dict[str, Any] = {}

    def add(name: str, value: Any) -> None:
        if isinstance(value, Mapping):
            for key, item in value.items():
                add(name if key == "backend" else f"{name}.{key}", item)
        else:
            flat[name] = value

    for name, table in result.config.items():
        add(name, table)
    unimportant = {f"run.{name}" for name in WITHOUT_EFFECT}
    return {
        n: value
        for n, value in flat.items()
        if n not in unimportant and not n.endswith(".options.threads")
    }


def _setting_texts(name: str, values: tuple[Any, Any]) -> list[str]:
    """Return two values of a setting as texts, backends of different names without their
    distributions.
    """
    full = [str(value) for value in values]
    short = [text.rpartition(":")[2] for text in full]
    return full if "." in name or short[0] == short[1] else short


def _median_depth(depths: FloatArray) -> float | None:
    return float(np.median(depths)) if len(depths) else None


def _usable_text(result: Reconstruction) -> str:
    return usable_text(result.usable, len(result.people))


def _person_title(person: PersonPair) -> str:
    one, other = person.index
    if one == other:
        return f"person {one}"
    return "person " + ", ".join(
        f"{i} of {name}" for name, i in zip("AB", (one, other), strict=True) if i is not None
    )


def _mark_texts(pair: tuple[Marks | None, Marks | None]) -> tuple[str, str]:
    one, other = ("-" if marks is None else marks_text(marks) for marks in pair)
    return one, other


def _metres_text(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} m"


def _mark_changes(pair: tuple[Marks | None, Marks | None]) -> Iterator[tuple[str, str]]:
    """Yield each mark that both results have, and in words how that of B compares to that of A.
    Within TRUST_NOISE of the probability they are the same.
    """
    one, other = pair
    if one is None or other is None:
        return
    for name in MARKS:
        before, after = one[name], other[name]
        if before is None or after is None:
            continue
        same = is_usable(before) == is_usable(after) or abs(after - before) <= TRUST_NOISE
        yield name, "the same" if same else "better" if after > before else "worse"


def _change_text(pair: tuple[Marks | None, Marks | None]) -> str:
    changed = [f"{name} {step}" for name, step in _mark_changes(pair) if step != "the same"]
    return ", ".join(changed)


def _distance_change(metres: float) -> str:
    """Return a difference of distances: below a metre in the unit of the joints' differences."""
    return f"{metres:+.2f} m" if abs(metres) >= 1 else f"{round(1000 * metres):+d} mm"


def _sections(photo: Comparison) -> Iterator[tuple[str, Sequence[tuple[Any, ...]]]]:
    """Yield title and rows of the photo and of each person: name, value of A and of B, and how they
    differ.
    """
    a, b = photo.depth_m
    ratio = f"x {b / a:.2f}" if a and b else ""
    depth = ("median depth of the scene", _metres_text(a), _metres_text(b), ratio)
    yield "Photo", [("usable", *photo.usable, ""), depth]
    for person in photo.people:
        distance_a, distance_b = person.distance_m
        further = (
            ""
            if distance_a is None or distance_b is None
            else _distance_change(distance_b - distance_a)
        )
        differences = {"joints": person.joints, "pose": person.pose}
        rows = [
            ("usable", *_mark_texts(person.marks), _change_text(person.marks)),
            ("distance", _metres_text(distance_a), _metres_text(distance_b), further),
            *(
                (name, "", "", str(value))
                for name, value in differences.items()
                if value is not None
            ),
            ("contact", *person.contacts, ""),
        ]
        yield _person_title(person).capitalize(), rows
