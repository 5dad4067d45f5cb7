"""``physic run``: reconstruct one photo and write a folder of results."""

from __future__ import annotations

import itertools
import logging
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from physic_core.types import Reconstruction

__all__ = ["run"]


class _Intrinsics(click.ParamType[Any]):
    name = "fx,fy,cx,cy"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != 4:
            self.fail(f"'{value}' is not four numbers with commas between them: fx,fy,cx,cy in px", param, ctx)
        return numbers


class _Path(click.ParamType[Path]):
    """Any path; the code that opens it reports errors."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        if not str(value):
            self.fail("it is empty: name a file or a folder", param, ctx)
        return Path(value)


_OUT = (
    "Folder for the results.  [default: photo-physic for photo.jpg; photo.jpg-physic, photo.jpg-physic-2, ... if taken]"
)


@click.command()
@click.argument("photo", type=_Path())
@click.option(
    "-o",
    "--out",
    type=_Path(),
    help=_OUT,
)
@click.option(
    "--overwrite",
    is_flag=True,
    help="Replace another photo's result, or changed files of a result.",
)
@click.option("--config", "file", metavar="FILE", type=_Path(), help="A TOML file, or reconstruction.json of a run.")
@click.option("--preset", metavar="NAME", help="Preset to build on.  [default: embedded]")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Change one value; may be repeated.")
@click.option("--focal-px", type=float, metavar="PX", help="Focal length in px of the photo file.")
@click.option("--intrinsics", type=_Intrinsics(), help="Camera in px of the photo file.")
@click.option("--device", metavar="NAME", help="cpu, cuda or cuda:N.")
@click.option("--low-memory", is_flag=True, help="Close each backend right after its last use.")
@click.option("--no-cache", is_flag=True, help="Do not read or write the cache of backends' outputs.")
def run(
    photo: Path,
    out: Path | None,
    overwrite: bool,
    file: Path | None,
    preset: str | None,
    overrides: tuple[str, ...],
    focal_px: float | None,
    intrinsics: tuple[float, ...] | None,
    device: str | None,
    low_memory: bool,
    no_cache: bool,
) -> None:
    """Reconstruct people, scene and contact from PHOTO."""
    if focal_px is not None and intrinsics is not None:
        raise click.UsageError("--focal-px and --intrinsics say the same thing: give one of them")
    if file is not None and preset is not None:
        raise click.UsageError('--config names its preset itself, with extends = "NAME": leave --preset out')

    from physic_core.configuration.resolve import load_checked, require_available, resolve
    from physic_core.discovery.plugins import discover

    flags: dict[str, dict[str, Any]] = {}
    if focal_px is not None:
        flags["--focal-px"] = {"photo": {"focal_px": focal_px}}
    if intrinsics is not None:
        flags["--intrinsics"] = {"photo": {"intrinsics": list(intrinsics)}}
    if device is not None:
        flags["--device"] = {"run": {"device": device}}
    if low_memory:
        flags["--low-memory"] = {"run": {"low_memory": True}}
    if no_cache:
        flags["--no-cache"] = {"run": {"cache": False}}

    # What fails cheaply fails first: nothing is loaded before config, files, device and output folder have held.
    registry = discover()
    config = load_checked(registry, file, preset=preset, overrides=overrides, flags=flags)
    plan = resolve(config, registry)
    require_available(plan)
    with _terminable(), _reserved(photo, out, overwrite) as folder:
        from physic_core.pipeline.run import reconstruct_photo

        with _said_by_plugins() as said, _progress() as progress:
            result = reconstruct_photo(photo, plan, progress=progress)
            result.save(str(folder), overwrite=overwrite)
    for line in said:
        click.echo(line, err=True)
    click.echo(_summary(result, folder))


class _Terminated(BaseException):
    """The process received SIGTERM; not an Exception, so that no plugin error handler catches it."""


@contextmanager
def _terminable() -> Iterator[None]:
    """Turn SIGTERM into an exception, so that cleanup runs as for Ctrl-C, and then end the process."""
    before = signal.getsignal(signal.SIGTERM)
    if threading.current_thread() is not threading.main_thread() or before is not signal.SIG_DFL:
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:
        raise _Terminated

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    except _Terminated:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTERM)  # so that the parent process sees the signal
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _reserved(photo: Path, out: Path | None, overwrite: bool) -> Iterator[Path]:
    """Yield an output folder that is writable and loses no data; an empty one is deleted at the end.

    This is checked before the run, which can take minutes.
    """
    from physic_core.files.atomic import check_writable
    from physic_core.io.result_folder import check_overwrite

    digest = _digest(photo)
    folder, made = (out, []) if out is not None else _default_folder(photo, digest, overwrite)
    parts = [*reversed(folder.absolute().parents), folder.absolute()]
    made += [part for part in parts if not os.path.exists(part)]  # Path's own raises where the way there is closed
    try:
        if digest:  # otherwise reading the photo reports the error
            check_overwrite(folder, digest, overwrite=overwrite)
        check_writable(folder)
        yield folder
    except BaseException:
        _remove(made)
        raise


def _digest(photo: Path) -> str:
    """Digests of the photo, if it can be read."""
    from physic_core.errors import InputError
    from physic_core.io.photo import read_photo
    from physic_core.io.result_folder import file_digest, photo_digest

    digest = file_digest(photo)
    if digest:
        with suppress(InputError):
            return photo_digest(photo, read_photo(photo).image)
    return digest


def _default_folder(photo: Path, digest: str, overwrite: bool) -> tuple[Path, list[Path]]:
    """Return the first folder named after the photo that is new or has its own result, and created folders.

    A new folder is created at once, so that two simultaneous runs use different ones.
    """
    from physic_core.io.result_folder import photo_of_result, same_photo

    first = Path(f"{photo.stem}-physic")
    if not digest:
        return first, []
    names = (f"{photo.name}-physic{'' if n == 1 else f'-{n}'}" for n in itertools.count(1))
    for folder in itertools.chain([first], map(Path, names)):
        made = False
        try:
            folder.mkdir()
            made = True
        except FileExistsError:
            whose = photo_of_result(folder)
            if whose is None or not (overwrite or same_photo(whose, digest)):
                continue
        except OSError:
            pass  # writing there reports the error
        if folder != first:
            click.echo(f"{first}{os.sep} is taken: results go to {folder}{os.sep}", err=True)
        return folder, [folder] * made
    raise AssertionError


def _remove(folders: list[Path]) -> None:
    """Delete the folders that were created, if they are empty."""
    for folder in reversed(folders):
        with suppress(OSError):  # the deepest may never have been made
            folder.rmdir()


@contextmanager
def _said_by_plugins() -> Iterator[list[str]]:
    """Collect the INFO log lines of plugins named ``physic_*``, each once, such as the device that is used."""
    said: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.name.startswith("physic_") and record.levelno == logging.INFO:
                if record.getMessage() not in said:
                    said.append(record.getMessage())
            elif record.levelno >= logging.WARNING and len(root.handlers) == 1 and logging.lastResort:
                logging.lastResort.handle(record)  # the default output of records without a handler

    root, listener = logging.getLogger(), Listener(logging.INFO)
    level = root.level
    root.addHandler(listener)
    root.setLevel(min(level, logging.INFO))
    try:
        yield said
    finally:
        root.removeHandler(listener)
        root.setLevel(level)


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    """Progress bar on a terminal, otherwise one line for each stage; on stderr, so that stdout has only the summary."""
    if not sys.stderr.isatty():
        yield lambda name, done, total: click.echo(f"[{done + 1}/{total}] {name}", err=True)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<24}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def show(name: str, done: int, total: int) -> None:
            bar.update(task, description=name, completed=done, total=total)

        yield show


def _summary(result: Reconstruction, folder: Path) -> str:
    people = len(result.people)
    seconds = sum(s.seconds for s in result.stages)
    loading = sum(s.load_seconds for s in result.stages)
    lines = [f"{people} {'person' if people == 1 else 'people'} in {seconds:.1f} s, and {loading:.1f} s to load models"]
    asked = [s for s in result.stages if s.provenance is not None]
    cached = sum(s.cached for s in asked)
    if cached:
        lines.append(f"{cached} of {len(asked)} answers of backends come from the cache; --no-cache asks them all")
    for i, person in enumerate(result.people):
        touching = int(person.contact.sum())
        failed = f"; check: {', '.join(person.failed_checks)}" if person.failed_checks else ""
        distance = float(person.joints[0, 2])
        if math.isfinite(distance):
            place = f"{distance:.1f} m away, {touching} of {len(person.contact)} vertices touch"
        else:
            place = "no body"
        lines.append(f"  person {i}: {place}{failed}")
    lines += [f"note: {text}" for text in result.notes]
    lines += [f"warning: {text}" for text in result.warnings]
    lines.append(f"results: {folder}{'' if str(folder).endswith('/') else '/'}  (look at preview.png first)")
    return "\n".join(lines)
