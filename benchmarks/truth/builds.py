"""Two builds of the tool, each in its own interpreter, and their answers, kept by the content of
the code and of the photo.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from .fields import measured, usable_of
from .sets import picture_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from typing import TypeAlias

    from numpy.typing import NDArray

    from .sets import Picture, Sample

    Ask: TypeAlias = "Callable[[Question], SimpleNamespace]"

ROOT = Path(__file__).resolve().parents[2]
CODE = ("physic_core", "plugins", ":!*/tests/*", ":!*.md")
WORKER = Path(__file__).with_name("worker.py")


@dataclass(frozen=True)
class Build:
    """A checkout with an environment.

    Attributes:
        root: its folder.
        python: its interpreter.
        commit: as Git describes it, "+" after it if files differ from it.
        content: hash of the code, which commits of other files leave.
        preset: of all runs; None with a configuration.
        settings: overrides, ``KEY=VALUE``.
        config: file of a configuration.
    """

    root: Path
    python: Path
    commit: str
    content: str
    preset: str | None = "embedded"
    settings: tuple[str, ...] = ()
    config: Path | None = None


def build_of(
    root: Path, preset: str | None, settings: Sequence[str] = (), config: Path | None = None
) -> Build:
    """Return the build of a checkout.

    Raises:
        SystemExit: the folder is no checkout, or has no environment.
    """
    root = root.resolve()
    python = Path(sys.executable) if root == ROOT else root / ".venv" / "bin" / "python"
    if not (root / "physic_core").is_dir():
        raise SystemExit(f"{root} is no checkout: it has no folder physic_core")
    if not python.exists():
        raise SystemExit(f"{root} has no environment: run `make lint` there, which makes .venv")
    files = _git(root, "ls-files", "-s", "--", *CODE)
    changed = _git(root, "diff", "HEAD", "--", *CODE)
    for name in _git(root, "ls-files", "-o", "--exclude-standard", "--", *CODE).splitlines():
        changed += name + hashlib.sha256((root / name).read_bytes()).hexdigest()
    content = hashlib.sha256(f"{files}\n{changed}".encode()).hexdigest()[:16]
    shown = _git(root, "rev-parse", "HEAD")[:8] + ("+" if changed else "")
    return Build(root, python, shown, content, preset, tuple(settings), config)


def keep_networks_only(cache: Path) -> None:
    """Delete what backends made of the outputs of networks: any change of the code makes it
    anew.
    """
    for file in (cache / "results").glob("*.npz"):
        if not file.name.startswith("network-"):
            file.unlink(missing_ok=True)


def _git(root: Path, *words: str) -> str:
    return subprocess.run(
        ["git", "-C", str(root), *words], check=True, capture_output=True, text=True
    ).stdout


@dataclass(frozen=True)
class Question:
    """A picture for both builds.

    Attributes:
        name: for people.
        picture: (H, W, 3) uint8 RGB.
        camera: fx, fy, cx, cy in px, or None.
        depth: whether the depth map is asked for.
        bodies: file of given bodies.
    """

    name: str
    picture: NDArray[np.uint8]
    camera: tuple[float, ...] | None = None
    depth: bool = False
    bodies: Path | None = None

    def key(self, build: Build) -> str:
        """Return the name of the answer's file."""
        of = [list(self.picture.shape), self.camera, self.depth, build.preset, build.settings]
        text = json.dumps(of).encode()
        for file in (self.bodies, build.config):
            text += file.read_bytes() if file else b""
        return hashlib.sha256(text + np.ascontiguousarray(self.picture).tobytes()).hexdigest()[:24]


def question_of(sample: Sample, *, with_camera: bool = True) -> Question:
    """Return what a sample asks: its picture, with the camera where it is known."""
    gives_camera = with_camera and sample.K is not None
    camera = sample.K[[0, 1, 0, 1], [0, 1, 2, 2]] if gives_camera else None
    return Question(
        f"{sample.set} {sample.name}",
        rgb(picture_of(sample)),
        None if camera is None else tuple(float(f"{v:.6g}") for v in camera),
        depth="depth_file" in sample.truth,
    )


def rgb(picture: Picture) -> Picture:
    """Return a BGR picture as RGB, or the reverse."""
    return np.ascontiguousarray(picture[..., ::-1])


@contextlib.contextmanager
def asked(build: Build, out: Path, title: str = "") -> Iterator[Ask]:
    """Yield a function that returns what a build answers to a question: from the file of an earlier
    run if there is one. The build is started for the first that is missing.

    Raises:
        SystemExit: the build ended early.
    """
    folder = out / "answers" / build.content
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        started = cache(lambda: stack.enter_context(_started(build, out)))

        def ask(question: Question) -> SimpleNamespace:
            file = folder / f"{question.key(build)}.npz"
            if not file.exists():
                _ask(started(), question, file, Path(place))
                keep_networks_only(_cache(build, out))
                print(title, question.name, file=sys.stderr, flush=True)
            answer = recorded(file)
            answer.size = question.picture.shape[1::-1]
            return answer

        yield ask


def _started(build: Build, out: Path) -> subprocess.Popen[str]:
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    environment["PHYSIC_CACHE"] = str(_cache(build, out).resolve())
    with (out / f"{build.content}.log").open("a") as log:
        worker = subprocess.Popen(
            [str(build.python), "-P", str(WORKER)],
            cwd=build.root,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
    start = {
        "preset": build.preset,
        "config": [str(build.config.resolve())] if build.config else [],
        "settings": ["run.cache_mb=100000", *build.settings],
    }
    with contextlib.suppress(BrokenPipeError):
        print(json.dumps(start), file=worker.stdin, flush=True)
    return worker


def _cache(build: Build, out: Path) -> Path:
    """Return the folder of the outputs of networks, which most changes of the code leave."""
    return out / "cache" / build.root.name


def _ask(worker: subprocess.Popen[str], question: Question, file: Path, place: Path) -> None:
    import cv2

    assert worker.stdin is not None
    assert worker.stdout is not None
    photo = place / "photo.png"
    cv2.imwrite(str(photo), rgb(question.picture))
    settings: dict[str, Any] = {"intrinsics": question.camera} if question.camera else {}
    if question.bodies:
        settings["bodies"] = str(question.bodies.resolve())
    job = {"photo": str(photo), "settings": settings, "depth": question.depth, "out": str(file)}
    with contextlib.suppress(BrokenPipeError):
        print(json.dumps(job), file=worker.stdin, flush=True)
    if worker.stdout.readline().strip() != "done":
        with contextlib.suppress(BrokenPipeError):
            worker.stdin.close()
        words = f"{worker.args[0]} ended with {worker.wait()}"  # type: ignore[index]
        raise SystemExit(f"{words} at {question.name}: see its log beside the answers")


def recorded(file: Path) -> SimpleNamespace:
    """Return an answer: ``record``, what its build states, ``people`` with their masks, and
    ``depth`` (H, W), None if it was not asked for.
    """
    with np.load(file, allow_pickle=False) as arrays:
        record = json.loads(str(arrays["record"]))
        packed, depth = arrays.get("masks"), arrays.get("depth")
    people = []
    for i, person in enumerate(record.get("people", ())):
        mask = np.unpackbits(packed[i], axis=-1, count=record["camera"]["width"]).astype(bool)
        joints = np.array(person["joints"], np.float64)
        people.append(SimpleNamespace(mask=mask, joints=joints, usable=usable_of(person)))
    return SimpleNamespace(record=record, people=people, depth=depth)


def measured_of(answer: SimpleNamespace, sample: Sample) -> dict[str, Any]:
    """Return what is measured of an answer, in px of its picture."""
    return measured(answer.record, answer.size, sample, answer.depth)
