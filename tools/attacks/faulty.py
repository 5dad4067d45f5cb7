"""Mock backends that deviate, raise, hang or end their process if a photo has a mark; workers import this module."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from degenerate import DEVIATIONS, Deviation, mock_of
from physic_core.interfaces import INTERFACES
from physic_testing.worlds import build_world

MARK = 0xFAB
"""Mark of a photo, in its last pixel; the rest of the pixel is the index of a fault."""


def fail(error: BaseException) -> Callable[[], Any]:
    def deed() -> Any:
        raise error

    return deed


class Mute(Exception):
    def __str__(self) -> str:
        raise ValueError


def recurse() -> Any:
    return recurse()


def hang_with_the_interpreter_lock() -> None:
    ctypes.PyDLL(None).sleep(100_000)


def interfere() -> None:
    """Change what the next photos need, and go on."""
    os.chdir(os.sep)
    os.close(1)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    np.seterr(all="raise")
    print("[]")


RAISING: dict[str, tuple[Callable[[], Any], str]] = {
    "ValueError": (fail(ValueError("three\nlines\nhere")), "BackendError"),
    "sys.exit": (lambda: sys.exit(0), "BackendError"),
    "KeyboardInterrupt": (fail(KeyboardInterrupt()), "BackendError"),
    "GeneratorExit": (fail(GeneratorExit()), "BackendError"),
    "out of memory": (lambda: np.empty(1 << 58, np.uint8), "BackendError"),
    "recursion": (recurse, "BackendError"),
    "no message": (fail(Mute()), "BackendError"),
    "long message": (fail(ValueError("x" * 1_000_000)), "BackendError"),
    "returns nothing": (lambda: None, "BackendOutputError"),
}
"""What the segmenter does in place of its work, and the class of the error."""

ENDING: dict[str, Callable[[], Any]] = {
    "killed": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "aborted": os.abort,
    "exited": lambda: os._exit(0),
}
"""What ends the worker."""

HANGING: dict[str, Callable[[], Any]] = {
    "hangs": lambda: time.sleep(100_000),
    "hangs with the lock": hang_with_the_interpreter_lock,
}

OTHER_WORLDS = {
    "segmenter-all-True_mask",
    "segmenter-person_of_1_pixel",
    "segmenter-8_people_of_1_pixel",
    "inpainter-read-only_and_strided",
    "inpainter-black",
}
"""Valid deviations whose people or image are not of the world, which the next mock backend refuses."""


def error_of(deviation: Deviation) -> str:
    """Return the class of the error, or "" for a result."""
    if deviation.refused:
        return "BackendOutputError"
    return "BackendError" if str(deviation) in OTHER_WORLDS else ""


Fault = tuple[str, str, Callable[[Any], Any]]
"""Interface, class of the error or "" for a result, and what becomes of the result of the mock backend."""

REPLACED = "replaced while it is reconstructed"
"""The file of the photo is replaced by the next one of its name; see :func:`numbered`."""

REAL = "no world"
"""A photo of a camera, for which the mock backends return what they know of a world of its size."""

FOLDER = "BROKEN_BATCH_FOLDER"
"""Environment variable: folder of the photos that replace others, called NUMBER.png."""

FAULTS: dict[str, Fault] = {
    REPLACED: ("segmenter", "", lambda result: result),
    REAL: ("segmenter", "", lambda result: result),
    **{name: ("segmenter", error, lambda _, deed=deed: deed()) for name, (deed, error) in RAISING.items()},
    **{name: ("segmenter", "WorkerDied", lambda _, deed=deed: deed()) for name, deed in ENDING.items()},
    **{name: ("segmenter", "Timeout", lambda _, deed=deed: deed()) for name, deed in HANGING.items()},
    "interferes": ("segmenter", "", lambda result: interfere() or result),
    **{str(d): (d.interface, error_of(d), d.change) for d in DEVIATIONS},
}


@cache
def photo(height: int = 72, width: int = 96) -> np.ndarray:
    """Return a photo (H, W, 3) uint8 RGB without a fault."""
    return build_world("stand", size=(width, height)).image


def mark(fault: str) -> np.ndarray:
    """Return a photo (H, W, 3) uint8 RGB that has a fault."""
    number = (list(FAULTS).index(fault) << 12) | MARK
    return with_last_pixel(photo(), [number >> 16, number >> 8 & 255, number & 255])


def as_real(image: np.ndarray) -> np.ndarray:
    """Return a photo of a camera (H, W, 3) with the mark :data:`REAL`."""
    return with_last_pixel(image, mark(REAL)[-1, -1])


def numbered(image: np.ndarray, number: int) -> np.ndarray:
    """Return a photo whose file is replaced by that of a number as soon as it is read."""
    changed = with_last_pixel(image, mark(REPLACED)[-1, -1])
    changed[-1, -2] = list(number.to_bytes(3))
    return changed


def replace_file(image: np.ndarray) -> None:
    number = int.from_bytes(image[-1, -2].tobytes())
    folder = Path(os.environ[FOLDER])
    for source in folder.glob(f"{number}.png"):
        os.replace(source, (folder / f"{number}.txt").read_text())


def with_last_pixel(image: np.ndarray, color: Any) -> np.ndarray:
    changed = image.copy()
    changed[-1, -1] = color
    return changed


def fault_of(image: np.ndarray) -> Fault | None:
    number = int.from_bytes(image[-1, -1].tobytes())
    return list(FAULTS.values())[number >> 12] if number & 0xFFF == MARK and number >> 12 < len(FAULTS) else None


def _faulty(interface: str) -> type:
    mock = mock_of(interface)

    def infer(self: Any, image: Any, *arguments: Any) -> Any:
        fault = fault_of(image)
        if fault is None:
            return mock.infer(self, image, *arguments)
        # The mock backends refuse a photo that is not of their world.
        unmarked = with_last_pixel(image, photo(*image.shape[:2])[-1, -1])
        if fault in (FAULTS[REAL], FAULTS[REPLACED]):
            unmarked = photo(*image.shape[:2])
        if fault is FAULTS[REPLACED] and interface == "segmenter":
            replace_file(image)
        result = mock.infer(self, unmarked, *arguments)
        if fault[0] == interface:
            return fault[2](result)
        return with_last_pixel(result, image[-1, -1]) if interface == "inpainter" else result

    return type(f"Faulty{mock.__name__}", (mock,), {"infer": infer, "__module__": __name__})


BACKENDS = {interface: _faulty(interface) for interface in INTERFACES}
globals().update({kind.__name__: kind for kind in BACKENDS.values()})

SETTINGS = [
    "engine.joint.optimiser.steps=1",
    *(f'{interface}.backend="{__name__}:{kind.__name__}"' for interface, kind in BACKENDS.items()),
]
"""Settings over the preset mock."""
