"""Evaluate methods on a data set: reconstruct its pictures, score every frame, and say what the
figures depend on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.data_files import DamagedFrameError, picture_file
from physic_bench.predictions import LAYOUTS, READERS
from physic_bench.scoring import body_box, score_frame
from physic_core.backends.people import box_iou
from physic_core.errors import InputError, PhysicError

if TYPE_CHECKING:
    from physic_batch.photo_processor import BatchJob
    from physic_bench.bodies import BodyFiles
    from physic_bench.datasets.base import FrameSet
    from physic_bench.types import Frame, Prediction, Truth

    Record = dict[str, Any]

TIMEOUT_S = 1200.0
MAX_DISTANCE_M = 200.0
"""No person is annotated farther from the camera.

Millimetres and world coordinates of a map are.
"""

MIN_OVERLAP = 0.3
"""Median overlap of the boxes of results and annotated people.

Another frame or unit gives less than .1.
"""

LOGS = "logs"
PICTURES = "pictures"
"""Folders beside the reconstructions, of the workers' logs and of mirrored pictures."""

NAMED = 5
"""Frames without a result that the notes name."""


@dataclass(frozen=True)
class Method:
    """A method whose results are scored.

    Attributes:
        name: in the tables.
        reader: of its results, a key of ``READERS``.
        folder: of the results.
        failures: frame id -> why there is no result.
    """

    name: str
    reader: str
    folder: Path
    failures: Mapping[str, str] = field(default_factory=dict)

    def result(self, frame: Frame) -> tuple[Prediction | None, str]:
        """Return the result of a frame, in the camera frame, or None and the reason."""
        try:
            prediction = READERS[self.reader](self.folder, frame)
        except PhysicError as error:
            return None, str(error)
        return prediction, "" if prediction is not None else self.failures.get(
            frame.id, "no result"
        )


def _settings_of(frame: Frame) -> dict[str, Any]:
    """Return the settings of a photo with the true camera of a frame."""
    settings = {"intrinsics": frame.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()}
    lens = list(frame.camera.distortion)
    return {**settings, "distortion": lens} if any(lens) else settings


def reconstruct_frames(
    frames: Sequence[Frame],
    job: BatchJob,
    workers: int,
    report: Callable[[str], None],
    *,
    with_camera: bool = True,
) -> dict[str, str]:
    """Reconstruct all pictures as ``physic batch`` does; what is done already stays.

    Args:
        frames: of the data set.
        job: configuration and folder.
        workers: processes.
        report: called with one line at a time.
        with_camera: whether the pipeline gets the true camera.

    Returns:
        Frame id -> why it has no result.

    Raises:
        PhysicError: a backend cannot be loaded.
    """
    from physic_batch.journal import read_journals
    from physic_batch.photos import PhotoItem
    from physic_batch.run import plan_batch, run_batch, run_locally
    from physic_batch.workers import WorkerSettings
    from physic_core.files import check_writable

    out = Path(job.out)
    failed: dict[str, str] = {}
    items = []
    for frame in frames:
        try:
            path = picture_file(frame, out / PICTURES)
        except InputError as error:
            failed[frame.id] = str(error)
        else:
            camera = _settings_of(frame) if with_camera else {}
            items.append(PhotoItem(frame.id, str(path.resolve()), camera))
    plan = plan_batch(items, job)
    report(f"{len(items)} pictures: {len(plan.todo)} to reconstruct, {plan.done} done before")
    executor = partial(
        run_locally, settings=WorkerSettings(workers, TIMEOUT_S, check_writable(out / LOGS))
    )

    def on_row(row: Mapping[str, Any]) -> None:
        reason = f": {row['error']}: {row['message']}" if row["error"] else ""
        report(f"{row['state']} {row['id']}{reason}")

    run_batch(plan.todo, job, executor, out / "journal.jsonl", on_row)
    last = read_journals(out, ("state", "error", "message"))
    rows = {item.id: last[item.id] for item in items if item.id in last}
    return failed | {
        i: f"{row['error']}: {row['message']}"
        for i, row in rows.items()
        if row["state"] == "failed"
    }


def evaluate_methods(
    frame_set: FrameSet, methods: Sequence[Method], files: BodyFiles
) -> tuple[dict[str, list[Record]], FrameSet]:
    """Score methods on the frames of a data set.

    Args:
        frame_set: frames.
        methods: at least one.
        files: body models, by which contact is carried between meshes.

    Returns:
        Method -> one record per annotated person, of all frames in order; and the frames, with
        sentences on which the figures depend, and with those that are not scored.

    Raises:
        InputError: a method has no result of any frame, its results do not fall on the annotated
            people, or no frame has a truth that can be read.
    """
    records: dict[str, list[Record]] = {method.name: [] for method in methods}
    overlaps: dict[str, list[float]] = {method.name: [] for method in methods}
    left_out = dict(frame_set.left_out)
    several = len({frame.sequence for frame in frame_set.frames}) > 1
    for frame in frame_set.frames:
        try:
            truth = checked_truth(frame)
        except PhysicError as error:
            left_out[frame.id] = str(error)
            continue
        for method in methods:
            prediction, reason = method.result(frame)
            group = frame.sequence if several else frame.group or frame.id
            for record in score_frame(frame, truth, prediction, files, reason):
                records[method.name].append(record | {"group": group})
            if prediction is not None:
                overlaps[method.name] += _overlaps(frame, truth, prediction)
    if not any(records.values()):
        raise InputError(
            f"no frame can be evaluated: {next(iter(left_out.values()), 'no person is annotated')}"
        )
    notes = list(frame_set.notes)
    for method in methods:
        _require_results(method, records[method.name], overlaps[method.name])
        notes += _notes(method.name, records[method.name])
    if left_out:
        notes.append(f"{len(left_out)} frames skipped; results.json has the reasons")
    return records, replace(frame_set, notes=tuple(notes), left_out=left_out)


def checked_truth(frame: Frame) -> Truth:
    """Return the truth of a frame.

    Raises:
        DamagedFrameError: a file is damaged, or a body is not in metres.
    """
    truth = frame.truth()
    for person in truth.people:
        points = person.joints if person.vertices is None else person.vertices
        if points is not None and np.isfinite(points).any():
            distance = float(np.nanmedian(np.linalg.norm(points, axis=-1)))
            if distance > MAX_DISTANCE_M:
                raise DamagedFrameError(
                    f"an annotated person is {distance:.0f} m away: lengths must be meters"
                )
    return truth


def _overlaps(frame: Frame, truth: Truth, prediction: Prediction) -> list[float]:
    """Return the best overlap of the box of each annotated person with those of a result; 0 of one
    who is not in the picture.
    """
    if not truth.people or not prediction.people:
        return []
    K = frame.camera.K if prediction.K is None else prediction.K
    true, boxes = (
        np.array([body_box(person, k) for person in people])
        for people, k in ((truth.people, frame.camera.K), (prediction.people, K))
    )
    best: list[float] = box_iou(true, boxes).max(1).tolist()
    return best


def _require_results(method: Method, records: Sequence[Record], overlaps: Sequence[float]) -> None:
    """Refuse a folder without a result of any frame, and results in another frame of reference."""
    if not any(record["has_result"] for record in records):
        raise InputError(
            f"{method.folder} has no result of {method.name} for any of "
            f"{len({r['frame'] for r in records})} frames; {records[0]['frame']}: "
            f"{records[0]['reason']}. The reader '{method.reader}' expects {LAYOUTS[method.reader]}"
        )
    if overlaps and median(overlaps) < MIN_OVERLAP:
        raise InputError(
            f"the results of {method.name} do not project onto the annotated people: median "
            f"overlap of the boxes {median(overlaps):.2f}. They must be of these pictures, in "
            "meters, in OpenCV's camera frame (x right, y down, z forward)"
        )


def _notes(name: str, records: Sequence[Record]) -> list[str]:
    """Return the sentences about a method that a reader of the table needs."""
    notes = []
    if joints := sorted({r["joints"] for r in records if "joints" in r}):
        notes.append(f"{name}: joints compared: {', '.join(joints)}")
    for transfer_text in sorted(
        {str(r[key]) for r in records for key in ("carried", "contact_carried") if key in r}
    ):
        notes.append(f"{name}: approximation: {transfer_text} transferred between the T-poses")
    notes += [
        f"{name}: not measured: {text}"
        for text in sorted({t for r in records for t in r["unmeasured"]})
    ]
    missing_results = {r["frame"]: r["reason"] for r in records if not r["has_result"]}
    if missing_results:
        named = ", ".join(
            f"{frame} ({reason})" for frame, reason in [*missing_results.items()][:NAMED]
        )
        more_text = (
            f", and {len(missing_results) - NAMED} more in results.json"
            if len(missing_results) > NAMED
            else ""
        )
        notes.append(
            f"{name}: {len(missing_results)} of {len({r['frame'] for r in records})} frames "
            f"without a result: {named}{more_text}"
        )
    missed = sum(not r["found"] for r in records)
    if missed:
        notes.append(
            f"{name}: {missed} of {len(records)} people without a body; contact counts them as "
            f"missed"
        )
    return notes
