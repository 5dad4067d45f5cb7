"""Wrong backends that no change of an answer makes: one mistake each, in the class, its options or
its life cycle, or in what it does to the process, and the check that must catch it.
"""

from __future__ import annotations

import inspect
import mmap
import os
import socket
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from pydantic import ConfigDict, Field
from stand_ins import SIZE, RightDepth, stand_in

from physic_core import interfaces
from physic_core.errors import BackendError
from physic_core.types import DepthMap, Hints
from physic_testing.conformance.cases import build_case

WRONG = {}
"""Mistake -> the class that does it, and the one check that catches it."""


def wrong(mistake, check):
    def note(kind):
        WRONG[mistake] = kind, check
        return kind

    return note


# ---- the class and its options


@wrong("infer without hints", "class_fits_its_interface")
class Narrow(RightDepth):
    def infer(self, image):
        return super().infer(image, Hints())


@wrong("options that take any key", "options_are_complete")
class Open(RightDepth):
    class Options(RightDepth.Options):
        model_config = ConfigDict(extra="ignore")


@wrong("an option without description", "options_are_complete")
class Silent(RightDepth):
    class Options(RightDepth.Options):
        gain: float = 1.0


@wrong("an option that JSON cannot hold", "options_are_complete")
class Unwritable(RightDepth):
    class Options(RightDepth.Options):
        dtype: Any = Field(np.float32, description="Type of the answer.")


# ---- construction, weights


@wrong("download in the constructor", "constructs_quickly_and_offline")
class Downloading(RightDepth):
    def __init__(self, options=None):
        super().__init__(options)
        socket.create_connection(("weights.example", 443))


@wrong("weights read by the constructor", "constructs_quickly_and_offline")
class Heavy(RightDepth):
    def __init__(self, options=None):
        super().__init__(options)
        self.weights = np.ones(16_000_000)


@wrong("missing weights as FileNotFoundError", "loads_or_reports_what_is_missing")
class Lost(RightDepth):
    def load(self, device="cpu"):
        raise FileNotFoundError("my_depth.onnx")


@wrong("a missing GPU as RuntimeError", "may_be_loaded_and_closed_again")
class Fast(RightDepth):
    def load(self, device="cpu"):
        if device != "cpu":
            raise RuntimeError("CUDA error: invalid device ordinal")
        super().load(device)


@wrong("not loaded as AttributeError", "may_be_loaded_and_closed_again")
class Surprised(RightDepth):
    def infer(self, image, hints):
        if not self.loaded:
            raise AttributeError("'NoneType' object has no attribute 'run'")
        return super().infer(image, hints)


def work():
    """As reading weights would take."""
    end = time.process_time() + 0.3
    while time.process_time() < end:
        pass


@wrong("what is missing, found by reading it", "tells_what_is_missing_before_load")
class KnownMistake(RightDepth):
    def missing(self):
        work()
        return ()


@wrong("no second load", "may_be_loaded_and_closed_again")
class LoadsOnce(RightDepth):
    ever = False

    def load(self, device="cpu"):
        if not self.ever:
            super().load(device)
        self.ever = True


# ---- asking changes nothing


@wrong("writes into the photo", "does_not_modify_its_input")
class Writing(RightDepth):
    def infer(self, image, hints):
        answer = super().infer(image, hints)
        image[0, 0] = 0
        return answer


@wrong("one buffer for every answer", "output_depends_on_the_photo_alone")
class Recycling(RightDepth):
    def load(self, device="cpu"):
        super().load(device)
        if not hasattr(self, "buffer"):
            self.buffer = np.zeros((2000, 2000), np.float32)

    def infer(self, image, hints):
        answer = super().infer(image, hints)
        height, width = answer.depth.shape
        self.buffer[:height, :width] = answer.depth
        return replace(answer, depth=self.buffer[:height, :width])


@wrong("depth kept by the size of the photo", "output_depends_on_the_photo_alone")
class Cached(RightDepth):
    kept: ClassVar[dict[tuple[int, ...], Any]]

    def __init__(self, options=None):
        super().__init__(options)
        self.kept = {}

    def infer(self, image, hints):
        return self.kept.setdefault(image.shape, super().infer(image, hints))


def changing(method, change, undo=lambda: None):
    """A backend that changes a setting of the process in one of its methods, until it is closed."""

    def changed(self, *arguments):
        change()
        return getattr(super(kind, self), method)(*arguments)

    def close(self):
        undo()
        super(kind, self).close()

    changed.__signature__ = inspect.signature(getattr(RightDepth, method))
    kind = type("Changing", (RightDepth,), {method: changed, "close": close})
    return kind


for mistake, kind in {
    "a seed for everybody": changing("infer", lambda: np.random.seed(5)),
    "one thread for everybody": changing("load", lambda: torch.set_num_threads(1)),
    "a variable for everybody": changing(
        "load", lambda: os.environ.update(MY_DEPTH="1"), lambda: os.environ.pop("MY_DEPTH", None)
    ),
}.items():
    wrong(mistake, "changes_no_settings_of_the_process")(kind)


@wrong("a disparity of hints", "depth_is_along_z_and_upright")
class BlindDisparity(interfaces.MetricDepth):
    """Turns the given scene round, and never looks at the photo."""

    capabilities: ClassVar = {"ignores_image"}

    def infer(self, image, hints):
        if hints.scene is None:
            return DepthMap(np.ones(image.shape[:2], np.float32))
        return DepthMap(np.float32(5 / hints.scene.points[..., 2]))


@wrong("usage data in the home folder", "leaves_home_and_network_alone")
class Counting(RightDepth):
    def infer(self, image, hints):
        (Path.home() / ".my-depth").write_text("1")
        return super().infer(image, hints)


@wrong("usage data that are sent", "leaves_home_and_network_alone")
class Sending(RightDepth):
    def load(self, device="cpu"):
        super().load(device)
        with suppress(OSError):
            socket.create_connection(("usage.example", 443))


@wrong("a picture for debugging", "leaves_nothing_behind")
class Writer(RightDepth):
    def infer(self, image, hints):
        Path("depth.txt").write_text("1")
        return super().infer(image, hints)


@wrong("a line for each photo", "leaves_nothing_behind")
class Printing(RightDepth):
    def infer(self, image, hints):
        print("one more photo")
        return super().infer(image, hints)


@wrong("a list of all photos", "leaves_nothing_behind")
class Hoarding(RightDepth):
    def infer(self, image, hints):
        # always new memory; that of an array may be some freed before
        pages = np.frombuffer(mmap.mmap(-1, 8_000_000))
        pages[:] = 1
        self.__dict__.setdefault("seen", []).append(pages)
        return super().infer(image, hints)


# ---- what it declares and sees


@wrong("a camera that it promised", "states_what_it_promises")
class Forgetful(RightDepth):
    capabilities: ClassVar[tuple[str, ...]] = ("returns_intrinsics",)

    def infer(self, image, hints):
        return replace(super().infer(image, hints), intrinsics=None)


@wrong("fed BGR", "reads_images_as_rgb")
class Exchanged(RightDepth):
    """Answers poorly, but for a photo with red and blue exchanged."""

    def infer(self, image, hints):
        try:
            answer = super().infer(image, hints)
        except BackendError:
            return super().infer(np.ascontiguousarray(image[..., ::-1]), hints)
        return replace(answer, depth=answer.depth**2)


@wrong("a placeholder that looks at the image", "ignores_the_image")
class Looking(stand_in("MockKeypointDetector")):
    capabilities: ClassVar[tuple[str, ...]] = ("ignores_image",)

    def infer(self, image, people):
        if image.std() == 0 and len(people):
            case = build_case("one person", SIZE)
            return replace(
                super().infer(case.photo, people), confidence=np.zeros((len(people), 33))
            )
        return super().infer(image, people)


@wrong("an exact backend with errors", "is_exact")
class Inexact(RightDepth):
    capabilities: ClassVar[tuple[str, ...]] = ("exact",)

    def infer(self, image, hints):
        answer = super().infer(image, hints)
        return replace(answer, depth=answer.depth ** np.float32(1.05))
