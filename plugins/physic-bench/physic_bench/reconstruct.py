"""Reconstruct the pictures of a data set with the batch: workers, journal, and resume."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_bench.pictures import picture_file
from physic_bench.wording import counted
from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_bench.contract import Frame
    from physic_core.batch.photos import PhotoItem
    from physic_core.configuration.model import Config

TIMEOUT_S = 1200.0


@dataclass(frozen=True)
class ReconstructionSettings:
    """How this tool reconstructs the pictures.

    Attributes:
        preset: name of a preset; None is the default.
        config: a TOML file, or None.
        overrides: KEY=VALUE.
        workers: processes.
        with_camera: whether the pipeline gets the true camera.
    """

    preset: str | None = None
    config: Path | None = None
    overrides: tuple[str, ...] = ()
    workers: int = 1
    with_camera: bool = True

    def check(self) -> Config:
        """Return the configuration of the batch.

        Raises:
            PhysicError: the configuration is invalid, or files that it needs are missing.
        """
        from physic_core.batch.settings import batch_config
        from physic_core.configuration.resolve import load_checked_config, require_available, resolve
        from physic_core.discovery.plugins import discover

        registry = discover()
        config = load_checked_config(registry, self.config, preset=self.preset, overrides=self.overrides)
        config = batch_config(config, registry, cache=False)
        require_available(resolve(config, registry))
        return config


def photo_item(frame: Frame, folder: Path, *, with_camera: bool = True) -> PhotoItem:
    """Return the picture of a frame for the batch, with its camera.

    Raises:
        InputError: the frame has no readable picture of its camera's size.
    """
    from physic_core.batch.photos import PhotoItem

    path = picture_file(frame, folder)
    settings: dict[str, Any] = {}
    if with_camera:
        K = frame.camera.K
        settings["intrinsics"] = [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]
        if any(frame.camera.distortion):
            settings["distortion"] = list(frame.camera.distortion)
    return PhotoItem(frame.id, str(path.resolve()), settings)


def reconstruct_frames(
    frames: Sequence[Frame], out: Path, how: ReconstructionSettings, report: Callable[[str], None]
) -> dict[str, str]:
    """Reconstruct all pictures into a folder of ``physic batch``; what is done already stays.

    Returns:
        Frame id -> why it has no result.

    Raises:
        PhysicError: the configuration is invalid, or a backend cannot be loaded.
    """
    from physic_core.batch.journal import read_journals
    from physic_core.batch.process import BatchJob
    from physic_core.batch.run import plan_batch, run_batch, run_locally
    from physic_core.batch.workers import WorkerSettings
    from physic_core.files.atomic import check_writable

    config = how.check()
    job = BatchJob(config, str(check_writable(out).resolve()), "numbers")
    failed: dict[str, str] = {}
    items = []
    for frame in frames:
        try:
            items.append(photo_item(frame, out / "pictures", with_camera=how.with_camera))
        except InputError as error:
            failed[frame.id] = str(error)
    plan = plan_batch(items, job)
    report(f"{counted(len(items), 'picture')}: {len(plan.todo)} to reconstruct, {plan.done} done before")
    logs = check_writable(out / "logs")
    executor = partial(run_locally, settings=WorkerSettings(how.workers, TIMEOUT_S, logs))
    count = 0

    def on_row(row: Any) -> None:
        nonlocal count
        count += 1
        reason = f": {row['error']}: {row['message']}" if row["error"] else ""
        report(f"[{count}/{len(plan.todo)}] {row['state']} {row['id']}{reason}")

    run_batch(plan.todo, job, executor, out / "journal.jsonl", on_row)
    wanted = {item.id for item in items}
    for name, row in read_journals(out, ("state", "error", "message")).last.items():
        if name in wanted and row["state"] == "failed":
            failed[name] = f"{row['error']}: {row['message']}"
    return failed
