"""Records of a run: backends, stages with their times, results of self-checks, and files of
exports.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from pathlib import Path


MARKS = ("pose", "place", "contact", "size")
"""What is judged of a person: each has a probability to be right."""

USABLE = 0.7
"""Probability from which on a mark is usable: three of four are right (docs/checks.md)."""


@dataclass(frozen=True)
class Provenance:
    """Backend, plugin and options that produced a result.

    ``plugin`` is the import name of the plugin, ``version`` that of its ``distribution``.
    """

    interface: str
    backend: str
    plugin: str
    distribution: str
    version: str
    options: Mapping[str, Any]
    weights_license: str


@dataclass(frozen=True)
class StageRecord:
    """Name, times and backend of one stage of a run.

    Attributes:
        name: as in the progress bar.
        seconds: without loading weights.
        load_seconds: time to load weights.
        provenance: the backend, or None for a stage of the engine.
        cached: whether the result was read from the cache; the backend was then neither loaded nor
            called.
        failed: whether the backend failed; an optional backend's failure does not end the run.
    """

    name: str
    seconds: float
    load_seconds: float = 0.0
    provenance: Provenance | None = None
    cached: bool = False
    failed: bool = False


class CheckState(StrEnum):
    """Outcome of a self-check."""

    OK = "ok"
    """The value was measured and is within the threshold."""

    FAILED = "failed"
    """The value was measured and is beyond the threshold."""

    UNKNOWN = "unknown"
    """Nothing was measured; the message says why."""


def is_usable(probability: float | None) -> bool:
    """Return whether a mark of this probability is usable."""
    return probability is not None and probability >= USABLE


def marks_text(marks: Mapping[str, float | None]) -> str:
    """Return which marks of a person are usable: "place and size usable; pose doubtful".

    Args:
        marks: name of :data:`MARKS` -> probability, or None without checks.
    """
    parts = []
    for word, wanted in (("usable", True), ("doubtful", False)):
        names = [n for n, p in marks.items() if p is not None and is_usable(p) is wanted]
        if names:
            parts.append(f"{in_words(names)} {word}")
    return "; ".join(parts) or "not judged"


def usable_text(usable: Mapping[str, int], people: int) -> str:
    """Return for how many people each mark is usable: "place usable for 2 of 3 people, size for 3".

    Args:
        usable: name of :data:`MARKS` -> number of people for whom it is usable.
        people: their number.
    """
    if not people:
        return "no people"
    first, *others = (f"{name}{{}} for {count}{{}}" for name, count in usable.items())
    of = f" of {people} people" if people > 1 else " of 1 person"
    return ", ".join([first.format(" usable", of), *(other.format("", "") for other in others)])


def in_words(names: Sequence[str]) -> str:
    """Return names as a text: "place, contact and size"."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last


_YES = "1: yes"

_UNIT_FORMATS = {
    "share": (100, " %", 0),
    "log": (100, " %", 0),
    "m": (1, " m", 2),
    "deg": (1, "°", 0),
    "count": (1, "", 0),
}
"""Factor, symbol and digits after the point of each unit of checks."""


@dataclass(frozen=True)
class CheckResult:
    """Result of one self-check of a reconstruction; :mod:`physic_core.judge` lists all
    checks.

    Attributes:
        name: of the check; stable, so that results can be filtered by it.
        state: a :class:`CheckState` or its value.
        value: the measured number, or None if nothing was measured.
        threshold: the bound on ``value``.
        direction: whether ``value`` must be "at most" or "at least" the threshold.
        unit: of value and threshold.
        message: what is wrong and what to do if the check failed; the reason if nothing was
            measured; else the check as text.
        person: index into ``Reconstruction.people``, or None if the check is about the photo.
        label: the name that readers see; "" if ``title`` is the name in words.
        share_of: what a value of unit "share" is a share of: "the box diagonal"; "" if the label
            says it.
    """

    name: str
    state: CheckState
    value: float | None
    threshold: float
    direction: Literal["at most", "at least"]
    unit: str
    message: str
    person: int | None = None
    label: str = ""
    share_of: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", CheckState(self.state))

    def __str__(self) -> str:
        """Return label, value and bound: "Heads in the outline: 2, limit 1"."""
        bound = "" if self.value is None else f", {self.bound_text}"
        return f"{self.title}: {self.value_text}{bound}"

    @property
    def title(self) -> str:
        """The label, or the name in words if there is none."""
        return self.label or self.name.replace("_", " ").capitalize()

    @property
    def value_text(self) -> str:
        """The value with its unit: "3.3 % of the box diagonal", "4 cm", "yes"; or "not
        measured".
        """
        if self.value is None:
            return "not measured"
        if self.unit == _YES:
            return "yes" if self.value >= 1 else "no"
        factor, symbol, digits = self._scale
        value = factor * self.value
        bound = factor * self.threshold
        digits += factor == 100 and abs(value) < 10
        # A failed value does not look like its bound.
        while value != bound and round(value, digits) == round(bound, digits) and digits < 4:
            digits += 1
        number = f"{round(value, digits) + 0.0:.{digits}f}"  # no "-0"
        share = f" of {self.share_of}" if self.share_of else ""
        return f"{number.removesuffix('.0')}{symbol}{share}"

    @property
    def bound_text(self) -> str:
        """The threshold with its unit: "limit 3.5 %", "at least 90 %", "must be yes"."""
        if self.unit == _YES:
            return "must be yes"
        factor, symbol, _ = self._scale
        return (
            f"{'limit' if self.direction == 'at most' else 'at least'} "
            f"{factor * self.threshold:.4g}{symbol}"
        )

    @property
    def _scale(self) -> tuple[int, str, int]:
        """Factor, symbol and digits of value and threshold: centimeters below a meter."""
        if self.unit == "m" and self.threshold < 1:
            return 100, " cm", 0
        return _UNIT_FORMATS.get(self.unit, (1, f" {self.unit}", 2))

    @property
    def ok(self) -> bool:
        """Whether the value was measured and is within the threshold."""
        return self.state is CheckState.OK

    @property
    def failed(self) -> bool:
        """Whether the value was measured and is beyond the threshold."""
        return self.state is CheckState.FAILED


@dataclass(frozen=True)
class Measures:
    """Measures of one person, for the self-checks; None where nothing could be measured.

    Attributes:
        placement_problem: why keypoints, depth and floor did not place the body.
        joint_problem: why the joint fit left pose and position unchanged.
        assumed_support: whether an unseen support is assumed.
        body_in_mask_share: share of the silhouette within the mask, without pixels occluded by
            other people or nearer objects, or outside the photo.
        low_depth_ratio: median ratio of the photo's depth to the body's over the lowest visible
            part of the silhouette.
        clearance_m: gap between the body and the nearest surface or floor.
        sole_height_m: of the lowest sole over the floor.
        given_keypoints_px: distance of each keypoint that the user gave from that of the body.
        stature_px: of the standing person at the same depth; only with given keypoints.
        given_stature_m: given, or usual at the given age.
        shown_stature_m: by the photo.
        stature_sigmas: difference of the logarithms of both, in standard deviations.
    """

    placement_problem: str | None = None
    joint_problem: str | None = None
    assumed_support: bool | None = None
    body_in_mask_share: float | None = None
    low_depth_ratio: float | None = None
    clearance_m: float | None = None
    sole_height_m: float | None = None
    given_keypoints_px: Mapping[str, float] = field(default_factory=dict)
    stature_px: float | None = None
    given_stature_m: float | None = None
    shown_stature_m: float | None = None
    stature_sigmas: float | None = None


def summarize_checks(checks: Sequence[CheckResult]) -> str:
    """Return how many checks failed, were not measured, and are ok: "2 failed, 3 not measured, 24
    ok".
    """
    if not checks:
        return "no checks were run"
    count = Counter(check.state for check in checks)
    words = (
        (CheckState.FAILED, "failed"),
        (CheckState.UNKNOWN, "not measured"),
        (CheckState.OK, "ok"),
    )
    return ", ".join(
        f"{count[state]} {word}" for state, word in words if count[state] or state is CheckState.OK
    )


@dataclass(frozen=True)
class ExportedFiles:
    """Files of one export, which an exporter returns.

    Attributes:
        files: file name -> content; a file may lie in a folder: "meshes/head.stl".
        notes: sentences for the user.
    """

    files: dict[str, bytes]
    notes: tuple[str, ...] = ()


_NAMED_FILES = 4


@dataclass(frozen=True)
class Exported:
    """Result of an export.

    Attributes:
        files: paths of the written files.
        notes: sentences about frame, fit errors and what was omitted.
    """

    files: tuple[Path, ...]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        names = [file.name for file in self.files[:_NAMED_FILES]]
        if more := len(self.files) - len(names):
            names.append(f"{more} more")
        return f"Exported({', '.join(names)}; {len(self.notes)} notes)"
