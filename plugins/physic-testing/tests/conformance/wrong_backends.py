"""One wrong backend for each way of being wrong: a right one with one mistake, and the check that
must catch it.
"""

from __future__ import annotations

import inspect
import mmap
import socket
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import cv2
import numpy as np
import torch
from faults import fields, pelvis_at
from pydantic import ConfigDict, Field
from right_backends import (
    SIZE,
    Loaded,
    RightBodies,
    RightContact,
    RightHands,
    RightInpainter,
    RightKeypoints,
    RightMetricDepth,
    RightObserver,
    RightPointmap,
    RightSegmenter,
)
from scipy.spatial.transform import Rotation

from physic_core import interfaces
from physic_core.errors import BackendError
from physic_core.types import DepthMap, Hints, Skeleton
from physic_testing.conformance.cases import build_case


class Wrong(NamedTuple):
    """What is wrong, in words, the class that does it, and the one check that catches it."""

    mistake: str
    kind: type[interfaces.Backend]
    check: str

    @property
    def id(self):
        return f"{self.kind.interface}-{self.mistake}".replace(" ", "_")


WRONG = []


def wrong(mistake, check):
    def note(kind):
        WRONG.append(Wrong(mistake, kind, check))
        return kind

    return note


def answering(right, mistake, check, infer):
    """A right backend that answers ``infer(self, *arguments)``."""
    infer.__signature__ = inspect.signature(right.infer)
    wrong(mistake, check)(type(f"Wrong{right.__name__}", (right,), {"infer": infer}))


def altered(right, mistake, check, change):
    """A right backend whose answer goes through ``change(answer, *arguments)``."""

    def infer(self, *arguments):
        return change(right.infer(self, *arguments), *arguments)

    answering(right, mistake, check, infer)


def restless(right, mistake, check, fails, error):
    """A right backend that raises where ``fails(*arguments)``."""

    def infer(self, *arguments):
        if fails(*arguments):
            raise error
        return right.infer(self, *arguments)

    answering(right, mistake, check, infer)


# ---- the class and its options
# ---------------------------------------------------------------------------------------


@wrong("no infer", "class_fits_its_interface")
class Abstract(Loaded, interfaces.MetricDepth):
    pass


@wrong("infer without hints", "class_fits_its_interface")
class Narrow(RightMetricDepth):
    def infer(self, image):
        return super().infer(image, Hints())


@wrong("options that take any key", "options_are_complete")
class Open(RightMetricDepth):
    class Options(RightMetricDepth.Options):
        model_config = ConfigDict(extra="ignore")


@wrong("an option without default", "options_are_complete")
class Demanding(RightMetricDepth):
    class Options(RightMetricDepth.Options):
        path: str = Field(description="Of the weights.")


@wrong("an option without description", "options_are_complete")
class Silent(RightMetricDepth):
    class Options(RightMetricDepth.Options):
        gain: float = 1.0


@wrong("an option that JSON cannot hold", "options_are_complete")
class Unwritable(RightMetricDepth):
    class Options(RightMetricDepth.Options):
        dtype: Any = Field(np.float32, description="Type of the answer.")


# ---- construction, weights
# -------------------------------------------------------------------------------------------


@wrong("download in the constructor", "constructs_quickly_and_offline")
class Downloading(RightMetricDepth):
    def __init__(self, options=None):
        super().__init__(options)
        socket.create_connection(("weights.example", 443))


@wrong("a constructor that wants an environment variable", "constructs_quickly_and_offline")
class Fragile(RightMetricDepth):
    def __init__(self, options=None):
        super().__init__(options)
        raise KeyError("MY_DEPTH_HOME")


@wrong("weights read by the constructor", "constructs_quickly_and_offline")
class Heavy(RightMetricDepth):
    def __init__(self, options=None):
        super().__init__(options)
        self.weights = np.ones(16_000_000)


@wrong("missing weights as FileNotFoundError", "loads_or_reports_what_is_missing")
class Lost(RightMetricDepth):
    def load(self, device="cpu"):
        raise FileNotFoundError("my_depth.onnx")


@wrong("a missing GPU as RuntimeError", "refuses_a_missing_device")
class Fast(RightMetricDepth):
    def load(self, device="cpu"):
        if device != "cpu":
            raise RuntimeError("CUDA error: invalid device ordinal")
        super().load(device)


@wrong("not loaded as AttributeError", "may_be_loaded_and_closed_again")
class Surprised(RightMetricDepth):
    def infer(self, image, hints):
        if not self.loaded:
            raise AttributeError("'NoneType' object has no attribute 'run'")
        return super().infer(image, hints)


@wrong("close only once", "may_be_loaded_and_closed_again")
class ClosesOnce(RightMetricDepth):
    def close(self):
        if not self.loaded:
            raise AttributeError("session")
        super().close()


def work():
    """As reading weights would take."""
    end = time.process_time() + 0.3
    while time.process_time() < end:
        pass


@wrong("what is missing, found by reading it", "tells_what_is_missing_before_load")
class Reading(RightMetricDepth):
    def missing(self):
        work()
        return ()


@wrong("a fingerprint by reading all weights", "tells_what_is_missing_before_load")
class Hashing(RightMetricDepth):
    def fingerprint(self):
        work()
        return "e3b0c442"


@wrong("no second load", "may_be_loaded_and_closed_again")
class LoadsOnce(RightMetricDepth):
    ever = False

    def load(self, device="cpu"):
        if not self.ever:
            super().load(device)
        self.ever = True


# ---- the form of answers
# ---------------------------------------------------------------------------------------------

FORM = "returns_valid_output"
altered(RightMetricDepth, "depth as float16 text", FORM, fields(depth=lambda z: z.astype(str)))
altered(RightKeypoints, "confidence in percent", FORM, fields(confidence=lambda c: 100 * c))
altered(RightInpainter, "an image of floats", FORM, lambda a, *_: (a / 255).astype(np.float32))
altered(
    RightBodies,
    "rotation matrices",
    FORM,
    fields(parameters=fields(body_pose=lambda pose: np.zeros((len(pose), 21, 3, 3)))),
)
altered(RightHands, "confidence above 1", FORM, fields(confidence=lambda c: c + 1))
altered(RightContact, "a probability below 0", FORM, fields(probability=lambda p: p - 0.5))

altered(
    RightContact,
    "normalised over people",
    "rows_do_not_depend_on_other_people",
    fields(probability=lambda p: p * (1 - 0.1 * len(p))),
)
altered(
    RightContact,
    "coarser for all but the first",
    "rows_do_not_depend_on_other_people",
    fields(
        probability=lambda p: np.concatenate(
            [p[:1], np.round(p[1:] * 20).astype(np.float32) / 20 * 0.9]
        )
    ),
)
restless(
    RightMetricDepth,
    "one person at most",
    "accepts_photos_of_people",
    lambda image, hints: hints.people is not None and len(hints.people) > 1,
    IndexError("index 1 is out of bounds"),
)
altered(
    RightSegmenter,
    "masks that overlap",
    "accepts_photos_of_people",
    fields(masks=lambda m: m | (np.roll(m, 1, axis=0) & (len(m) > 1))),
)
altered(
    RightMetricDepth,
    "padded to a multiple of 8",
    "accepts_photos_of_people",
    fields(depth=lambda z: np.pad(z, [(0, -n % 8) for n in z.shape], mode="edge")),
)
altered(
    RightMetricDepth,
    "portraits left lying",
    "accepts_photos_of_people",
    fields(depth=lambda z: z.T if z.shape[0] > z.shape[1] else z),
)
altered(
    RightSegmenter,
    "None for nobody",
    "accepts_a_photo_without_people",
    lambda a, *_: a if len(a) else None,
)
for right in (RightKeypoints, RightBodies, RightHands, RightObserver, RightContact):
    restless(
        right,
        "nobody is an error",
        "accepts_a_photo_without_people",
        lambda image, people, *_: not len(people),
        ValueError("need at least one array to stack"),
    )
restless(
    RightMetricDepth,
    "blank is an error",
    "accepts_or_refuses_any_photo",
    lambda image, *_: image.std() == 0,
    ZeroDivisionError("float division by zero"),
)
restless(
    RightMetricDepth,
    "tiny is an error",
    "accepts_or_refuses_any_photo",
    lambda image, *_: image.shape[-1] == 3 and min(image.shape[:2]) < 32,
    ValueError("output size (0, 1)"),
)
restless(
    RightMetricDepth,
    "large is an error",
    "accepts_or_refuses_any_photo",
    lambda image, *_: max(image.shape[:2]) > 512,
    AssertionError("at most 512 px"),
)


# ---- asking changes nothing
# ------------------------------------------------------------------------------------------


@wrong("writes into the photo", "does_not_modify_its_input")
class Writing(RightMetricDepth):
    def infer(self, image, hints):
        answer = super().infer(image, hints)
        image[0, 0] = 0
        return answer


altered(
    RightMetricDepth,
    "hidden randomness",
    "output_depends_on_the_photo_alone",
    fields(depth=lambda z: z * np.random.default_rng().normal(1, 0.01, z.shape)),
)


@wrong("a mean over photos", "output_depends_on_the_photo_alone")
class Remembering(RightMetricDepth):
    scale = 1.0

    def infer(self, image, hints):
        answer = super().infer(image, hints)
        seen = self.scale
        self.scale = self.scale * 1.01
        return replace(answer, depth=answer.depth * np.float32(seen))

    def close(self):
        super().close()
        self.scale = 1.0


@wrong("one buffer for every answer", "output_depends_on_the_photo_alone")
class Recycling(RightMetricDepth):
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
class Cached(RightMetricDepth):
    kept: ClassVar[dict[tuple[int, ...], Any]]

    def __init__(self, options=None):
        super().__init__(options)
        self.kept = {}

    def infer(self, image, hints):
        return self.kept.setdefault(image.shape, super().infer(image, hints))


@wrong("a seed for everybody", "changes_no_settings_of_the_process")
class Seeding(RightMetricDepth):
    def infer(self, image, hints):
        np.random.seed(len(image))
        return super().infer(image, hints)


@wrong("faster products for everybody", "changes_no_settings_of_the_process")
class Precision(RightMetricDepth):
    def load(self, device="cpu"):
        super().load(device)
        torch.set_float32_matmul_precision("medium")

    def close(self):
        torch.set_float32_matmul_precision("highest")
        super().close()


@wrong("no gradients for everybody", "changes_no_settings_of_the_process")
class NoGradients(RightMetricDepth):
    def infer(self, image, hints):
        torch.set_grad_enabled(False)
        return super().infer(image, hints)

    def close(self):
        torch.set_grad_enabled(True)
        super().close()


@wrong("a disparity of hints", "depth_is_along_z_and_upright")
class BlindDisparity(interfaces.MetricDepth):
    """Turns the given scene round, and never looks at the photo."""

    capabilities: ClassVar = {"ignores_image"}

    def infer(self, image, hints):
        if hints.scene is None:
            return DepthMap(np.ones(image.shape[:2], np.float32))
        return DepthMap(np.float32(5 / hints.scene.points[..., 2]))


@wrong("a picture for debugging", "leaves_nothing_behind")
class Writer(RightMetricDepth):
    def infer(self, image, hints):
        Path("depth.txt").write_text("1")
        return super().infer(image, hints)


@wrong("a line for each photo", "leaves_nothing_behind")
class Printing(RightMetricDepth):
    def infer(self, image, hints):
        print("one more photo")
        return super().infer(image, hints)


@wrong("a list of all photos", "leaves_nothing_behind")
class Hoarding(RightMetricDepth):
    def infer(self, image, hints):
        # always new memory; that of an array may be some freed before
        pages = np.frombuffer(mmap.mmap(-1, 8_000_000))
        pages[:] = 1
        self.__dict__.setdefault("seen", []).append(pages)
        return super().infer(image, hints)


restless(
    RightMetricDepth,
    "arrays of its own kind only",
    "accepts_array_views",
    lambda image, *_: min(image.strides) < 0,
    ValueError("tensors with negative strides are not currently supported"),
)


# ---- depth
# --------------------------------------------------------------------------------------------------


def transposed(z):
    rows = np.arange(z.shape[0]) * z.shape[1] // z.shape[0]
    columns = np.arange(z.shape[1]) * z.shape[0] // z.shape[1]
    return z.T[np.ix_(rows, columns)]


def only_corner(z):
    kept = np.full_like(z, np.nan)
    kept[: z.shape[0] // 3, : z.shape[1] // 3] = z[: z.shape[0] // 3, : z.shape[1] // 3]
    return kept


for mistake, check, change in (
    ("only a corner", "depth_is_where_it_can_be_known", only_corner),
    ("transposed", "depth_is_along_z_and_upright", transposed),
    ("upside down", "depth_is_along_z_and_upright", np.flipud),
    ("disparity", "depth_is_along_z_and_upright", lambda z: np.median(z) ** 2 / z),
    ("centimetres", "depth_is_in_metres", lambda z: 100 * z),
):
    altered(RightMetricDepth, mistake, check, fields(depth=change))
altered(
    RightMetricDepth,
    "a sigma in percent",
    "states_what_it_promises",
    fields(scale_sigma=lambda _: 10.0),
)
for right in (RightMetricDepth, RightPointmap):
    restless(
        right,
        "hints that are there",
        "works_without_hints",
        lambda image, hints: hints.people is None,
        AttributeError("'NoneType' object has no attribute 'masks'"),
    )


@wrong("a camera that it promised", "states_what_it_promises")
class Forgetful(RightMetricDepth):
    capabilities: ClassVar[tuple[str, ...]] = ("returns_intrinsics",)

    def infer(self, image, hints):
        return replace(super().infer(image, hints), intrinsics=None)


def bgr(right):
    def infer(self, image, *rest):
        # The lookup that a network trained on RGB would be sees blue where red is.
        return right.infer(self, image[..., ::-1], *rest)

    answering(right, "fed BGR", "reads_images_as_rgb", infer)


for right in (RightSegmenter, RightMetricDepth, RightPointmap, RightKeypoints):
    bgr(right)


# ---- point maps
# --------------------------------------------------------------------------------------------------


restless(
    RightPointmap,
    "a camera that is there",
    "works_without_intrinsics",
    lambda image, hints: hints.intrinsics is None,
    AttributeError("'NoneType' object has no attribute 'fx'"),
)

restless(
    RightPointmap,
    "no second call",
    "accepts_the_photo_with_people",
    lambda image, hints: hints.scene is not None,
    BackendError("one call is enough"),
)


def to_the_right(up):
    sideways = np.array([0.2, *up[1:]])
    return sideways / np.linalg.norm(sideways)


altered(RightPointmap, "down", "up_is_against_gravity", fields(up=lambda up: -up))
altered(
    RightPointmap,
    "a sigma that is too small",
    "up_is_against_gravity",
    fields(up=lambda up: Rotation.from_euler("x", 9, degrees=True).apply(up)),
)
altered(
    RightPointmap,
    "the same up in a mirrored photo",
    "up_is_against_gravity",
    fields(up=to_the_right, up_sigma=lambda _: 4.5),
)


# ---- people
# --------------------------------------------------------------------------------------------------


def inverted(answer, *_):
    if not len(answer):
        return answer
    height, width = answer.masks.shape[1:]
    return replace(
        answer,
        masks=~answer.masks.any(axis=0, keepdims=True),
        boxes=np.array([[0.0, 0.0, width, height]]),
        scores=answer.scores[:1],
        floor=None,
    )


def dilated(answer, *_):
    grown = [
        cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0 for mask in answer.masks
    ]
    others = answer.masks.sum(axis=0) - answer.masks
    masks = np.array(grown, bool).reshape(answer.masks.shape) & (others == 0)
    free = np.cumsum(masks, axis=0) == 1
    return replace(answer, masks=masks & free, boxes=np.add(answer.boxes, [-2, -2, 2, 2]))


def boxes_to_the_waist(boxes):
    """The upper half of each box, as of a detector of upper bodies."""
    return np.column_stack([boxes[:, :3], (boxes[:, 1] + boxes[:, 3]) / 2])


altered(
    RightSegmenter,
    "boxes of upper bodies",
    "boxes_enclose_their_masks",
    fields(boxes=boxes_to_the_waist),
)
altered(RightSegmenter, "dilated masks", "masks_are_in_place", dilated)
altered(RightSegmenter, "inverted masks", "masks_lie_on_people", inverted)
altered(
    RightSegmenter,
    "worst score first",
    "masks_lie_on_people",
    fields(masks=np.flipud, boxes=np.flipud, scores=np.flipud),
)
for mistake, change in (
    ("an inverted floor", lambda floor, people: ~floor & ~people),
    ("people who are floor", np.logical_or),
):
    altered(
        RightSegmenter,
        mistake,
        "floor_mask_excludes_people",
        lambda a, *_, change=change: fields(floor=lambda f: change(f, a.masks.any(axis=0)))(a),
    )


# ---- inpainting
# --------------------------------------------------------------------------------------------------


restless(
    RightInpainter,
    "an empty mask is an error",
    "an_empty_mask_changes_nothing",
    lambda image, mask: not mask.any() and image.shape[0] > 32 and image.std() > 0,
    ValueError("zero-size array to reduction operation"),
)
restless(
    RightInpainter,
    "a full mask is an error",
    "an_empty_mask_changes_nothing",
    lambda image, mask: bool(mask.all()),
    IndexError("index 0 is out of bounds"),
)


# ---- keypoints
# --------------------------------------------------------------------------------------------------


def sorted_rows(answer, image, people, *_):
    """Rows by the people's boxes, whatever the order in which they were asked about."""
    order = np.argsort(people.boxes[:, 0])

    def by_size(thing):
        if isinstance(thing, np.ndarray):
            return thing[order]
        if hasattr(thing, "__dataclass_fields__"):
            return replace(thing, **{name: by_size(value) for name, value in vars(thing).items()})
        return thing

    return by_size(answer)


altered(
    RightKeypoints,
    "points that lie nowhere on a body",
    "skeleton_is_known",
    fields(skeleton=lambda _: Skeleton("dots", tuple(f"dot{i}" for i in range(33)))),
)
for right in (RightKeypoints, RightBodies, RightHands, RightContact):
    altered(right, "rows from left to right", "rows_follow_the_people", sorted_rows)


# ---- bodies, hands, contact
# ------------------------------------------------------------------------------------------


for mistake, check, change in (
    ("an unknown body", "bodies_can_be_posed", fields(body_model=lambda _: "mhr")),
    ("degrees", "returns_valid_output", fields(parameters=fields(body_pose=np.degrees))),
    ("an OpenGL camera", "bodies_are_in_front", pelvis_at(lambda pelvis: pelvis * [1, -1, -1])),
):
    altered(RightBodies, mistake, check, change)
restless(
    RightBodies,
    "hints that are there",
    "works_without_hints",
    lambda image, people, intrinsics, keypoints, hints: hints.floor is None,
    AttributeError("'NoneType' object has no attribute 'normal'"),
)
altered(
    RightBodies, "observed inverted", "observed_is_true_in_sight", fields(observed=np.logical_not)
)
altered(
    RightHands,
    "longer than a turn",
    "angles_are_radians",
    fields(rotvecs=lambda rotvecs: np.full_like(rotvecs, 4.0)),
)
altered(RightObserver, "1 is no touch", "touch_is_that_of_the_parts", fields(touch=lambda p: 1 - p))
altered(
    RightObserver,
    "right limbs touch",
    "mirrored_photo_exchanges_sides",
    fields(touch=lambda p: 0 * p + [0.2, 0.8, 0.2, 0.8, 0.5]),
)
altered(
    RightObserver,
    "faces that look into the heads",
    "head_looks_out_of_the_face",
    fields(head=np.negative),
)
altered(RightContact, "another mesh", "mesh_is_known", fields(topology=lambda _: "smplx"))


@wrong("a placeholder that looks at the image", "ignores_the_image")
class Looking(RightKeypoints):
    capabilities: ClassVar[tuple[str, ...]] = ("ignores_image",)

    def infer(self, image, people):
        if image.std() == 0 and len(people):
            case = build_case("one person", SIZE)
            return replace(
                super().infer(case.photo, people), confidence=np.zeros((len(people), 33))
            )
        return super().infer(image, people)


@wrong("an exact backend with errors", "is_exact")
class Inexact(RightMetricDepth):
    capabilities: ClassVar[tuple[str, ...]] = ("exact",)

    def infer(self, image, hints):
        answer = super().infer(image, hints)
        return replace(answer, depth=answer.depth ** np.float32(1.05))


altered(
    RightMetricDepth,
    "zero in the sky",
    "accepts_or_refuses_any_photo",
    fields(depth=lambda z: np.where(np.isfinite(z), z, 0)),
)
