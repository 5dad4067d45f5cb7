"""One wrong backend for each way of being wrong: a right one with one mistake, and the check that
must catch it.
"""

from __future__ import annotations

import mmap
import socket
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from pydantic import ConfigDict, Field
from right_backends import (
    SIZE,
    Knowing,
    RightBodies,
    RightContact,
    RightHands,
    RightInpainter,
    RightKeypoints,
    RightMetricDepth,
    RightOptions,
    RightPointmap,
    RightSegmenter,
)

from physic_core import interfaces
from physic_core.errors import BackendError
from physic_core.types import Hints, Skeleton
from physic_testing.conformance.cases import build_case


@dataclass(frozen=True)
class Wrong:
    """What is wrong, in words, the class that does it, and the one check that catches it.

    ``plugin`` is the source of the module that registers the class, where that is what is wrong.
    """

    mistake: str
    kind: type[interfaces.Backend]
    check: str
    plugin: str = ""

    @property
    def id(self):
        return f"{self.kind.interface}-{self.mistake}".replace(" ", "_")


WRONG = []


def wrong(mistake, check):
    def note(kind):
        WRONG.append(Wrong(mistake, kind, check))
        return kind

    return note


def altered(right, mistake, check, change):
    """A right backend whose answer goes through ``change(answer, *arguments)``."""

    def infer(self, *arguments):
        return change(right.infer(self, *arguments), *arguments)

    infer.__signature__ = __import__("inspect").signature(right.infer)
    WRONG.append(Wrong(mistake, type(f"Wrong{right.__name__}", (right,), {"infer": infer}), check))


def restless(right, mistake, check, fails, error):
    """A right backend that raises where ``fails(*arguments)``."""

    def infer(self, *arguments):
        if fails(*arguments):
            raise error
        return right.infer(self, *arguments)

    infer.__signature__ = __import__("inspect").signature(right.infer)
    WRONG.append(Wrong(mistake, type(f"Wrong{right.__name__}", (right,), {"infer": infer}), check))


# ---- the class and its options
# ---------------------------------------------------------------------------------------


WRONG.append(
    Wrong(
        "torch imported at registration",
        RightMetricDepth,
        "registration_is_light",
        "import torch\nfrom physic_core import hookimpl\n@hookimpl\ndef physic_commands():\n    "
        "return []\n",
    )
)


@wrong("no infer", "class_fits_its_interface")
class Abstract(Knowing, interfaces.MetricDepth):
    pass


@wrong("infer without hints", "class_fits_its_interface")
class Narrow(RightMetricDepth):
    def infer(self, image):
        return super().infer(image, Hints())


@wrong("options that take any key", "options_are_complete")
class Open(RightMetricDepth):
    class Options(RightOptions):
        model_config = ConfigDict(extra="ignore")


@wrong("an option without default", "options_are_complete")
class Demanding(RightMetricDepth):
    class Options(RightOptions):
        path: str = Field(description="Of the weights.")


@wrong("an option without description", "options_are_complete")
class Silent(RightMetricDepth):
    class Options(RightOptions):
        gain: float = 1.0


@wrong("an option that JSON cannot hold", "options_are_complete")
class Unwritable(RightMetricDepth):
    class Options(RightOptions):
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
altered(
    RightMetricDepth,
    "depth as float16 text",
    FORM,
    lambda a, *_: replace(a, depth=a.depth.astype(str)),
)
altered(
    RightKeypoints,
    "confidence in percent",
    FORM,
    lambda a, *_: replace(a, confidence=100 * a.confidence),
)
altered(
    RightSegmenter,
    "boxes x y w h",
    FORM,
    lambda a, *_: replace(
        a, boxes=np.concatenate([a.boxes[:, :2], a.boxes[:, 2:] - a.boxes[:, :2]], axis=1)
    ),
)
altered(RightInpainter, "an image of floats", FORM, lambda a, *_: (a / 255).astype(np.float32))
altered(RightBodies, "rotation matrices", FORM, lambda a, *_: replace(
    a, parameters=replace(a.parameters, body_pose=np.zeros((len(a.parameters), 21, 3, 3)))
))  # fmt: skip
altered(
    RightHands, "confidence above 1", FORM, lambda a, *_: replace(a, confidence=a.confidence + 1)
)
altered(
    RightContact,
    "a probability below 0",
    FORM,
    lambda a, *_: replace(a, probability=a.probability - 0.5),
)

altered(
    RightContact,
    "normalised over people",
    "rows_do_not_depend_on_other_people",
    lambda a, *_: replace(a, probability=a.probability * (1 - 0.1 * len(a.probability))),
)
altered(
    RightContact,
    "coarser for all but the first",
    "rows_do_not_depend_on_other_people",
    lambda a, *_: replace(
        a,
        probability=np.concatenate(
            [a.probability[:1], np.round(a.probability[1:] * 20).astype(np.float32) / 20 * 0.9]
        ),
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
    lambda a, *_: replace(a, masks=a.masks | (np.roll(a.masks, 1, axis=0) & (len(a.masks) > 1))),
)


def padded(answer, *_):
    rows, columns = (-n % 8 for n in answer.depth.shape)
    return replace(answer, depth=np.pad(answer.depth, ((0, rows), (0, columns)), mode="edge"))


def lying(answer, *_):
    return (
        replace(answer, depth=answer.depth.T)
        if answer.depth.shape[0] > answer.depth.shape[1]
        else answer
    )


altered(RightMetricDepth, "padded to a multiple of 8", "accepts_photos_of_people", padded)
altered(RightMetricDepth, "portraits left lying", "accepts_photos_of_people", lying)
altered(
    RightSegmenter,
    "None for nobody",
    "accepts_a_photo_without_people",
    lambda a, *_: a if len(a) else None,
)
for right in (RightKeypoints, RightBodies, RightHands, RightContact):
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


@wrong("hidden randomness", "output_depends_on_the_photo_alone")
class Random(RightMetricDepth):
    def infer(self, image, hints):
        answer = super().infer(image, hints)
        return replace(
            answer, depth=answer.depth * np.random.default_rng().normal(1, 0.01, answer.depth.shape)
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


def of_depth(change):
    return lambda a, *_: replace(a, depth=change(a.depth).astype(np.float32))


def transposed(z):
    rows = np.arange(z.shape[0]) * z.shape[1] // z.shape[0]
    columns = np.arange(z.shape[1]) * z.shape[0] // z.shape[1]
    return z.T[np.ix_(rows, columns)]


def only_corner(z):
    kept = np.full_like(z, np.nan)
    kept[: z.shape[0] // 3, : z.shape[1] // 3] = z[: z.shape[0] // 3, : z.shape[1] // 3]
    return kept


def normalised_camera(answer, *_):
    return replace(
        answer, intrinsics=answer.intrinsics and replace(answer.intrinsics, fx=1.2, fy=1.2)
    )


altered(RightMetricDepth, "only a corner", "depth_is_where_it_can_be_known", of_depth(only_corner))
altered(RightMetricDepth, "transposed", "depth_is_along_z_and_upright", of_depth(transposed))
altered(
    RightMetricDepth, "upside down", "depth_is_along_z_and_upright", of_depth(lambda z: z[::-1])
)
altered(
    RightMetricDepth,
    "disparity",
    "depth_is_along_z_and_upright",
    of_depth(lambda z: np.median(z) ** 2 / z),
)
altered(RightMetricDepth, "centimetres", "depth_is_in_metres", of_depth(lambda z: 100 * z))
altered(
    RightMetricDepth,
    "a focal length in shares of the width",
    "intrinsics_are_not_biased",
    normalised_camera,
)
altered(
    RightMetricDepth,
    "a sigma in percent",
    "states_what_it_promises",
    lambda a, *_: replace(a, scale_sigma=10.0),
)
restless(
    RightMetricDepth,
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
        return right.infer(
            self, image[..., ::-1] if image.ndim == 3 and image.shape[2] == 3 else image, *rest
        )

    infer.__signature__ = __import__("inspect").signature(right.infer)
    kind = type(f"Bgr{right.__name__}", (right,), {"infer": infer})
    WRONG.append(Wrong("fed BGR", kind, "reads_images_as_rgb"))


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
    "people that are there",
    "works_without_hints",
    lambda image, hints: hints.people is None,
    AttributeError("'NoneType' object has no attribute 'masks'"),
)
restless(
    RightPointmap,
    "no second call",
    "accepts_the_photo_with_people",
    lambda image, hints: hints.scene is not None,
    BackendError("one call is enough"),
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


def shares(answer, *_):
    height, width = answer.masks.shape[1:]
    return replace(answer, boxes=answer.boxes / [width, height, width, height])


def floor_over_people(answer, *_):
    return replace(
        answer, floor=None if answer.floor is None else answer.floor | answer.masks.any(axis=0)
    )


def dilated(answer, *_):
    import cv2

    grown = [
        cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0 for mask in answer.masks
    ]
    others = answer.masks.sum(axis=0) - answer.masks
    masks = np.array(grown, bool).reshape(answer.masks.shape) & (others == 0)
    free = np.cumsum(masks, axis=0) == 1
    return replace(answer, masks=masks & free, boxes=np.add(answer.boxes, [-2, -2, 2, 2]))


altered(RightSegmenter, "dilated masks", "masks_are_in_place", dilated)
altered(RightSegmenter, "inverted masks", "masks_lie_on_people", inverted)
altered(
    RightSegmenter,
    "worst score first",
    "masks_lie_on_people",
    lambda a, *_: replace(a, masks=a.masks[::-1], boxes=a.boxes[::-1], scores=a.scores[::-1]),
)
altered(
    RightSegmenter,
    "an inverted floor",
    "floor_mask_excludes_people",
    lambda a, *_: replace(a, floor=None if a.floor is None else ~a.floor & ~a.masks.any(axis=0)),
)
altered(RightSegmenter, "people who are floor", "floor_mask_excludes_people", floor_over_people)


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
    lambda a, *_: replace(
        a, skeleton=Skeleton("dots", tuple(f"dot{i}" for i in range(a.points.shape[1])))
    ),
)
altered(
    RightKeypoints,
    "y before x",
    "joints_are_those_of_the_person",
    lambda a, *_: replace(a, points=a.points[..., ::-1].copy()),
)
for right in (RightKeypoints, RightBodies, RightHands, RightContact):
    altered(right, "rows from left to right", "rows_follow_the_people", sorted_rows)


# ---- bodies, hands, contact
# ------------------------------------------------------------------------------------------


def of_parameters(change):
    return lambda a, *_: replace(a, parameters=replace(a.parameters, **change(a.parameters)))


def opengl(p):
    return placed(p, lambda pelvis: pelvis * [1, -1, -1])


def placed(p, move):
    """The pelvis moved: the rest pelvis of the body is not at its origin."""
    import torch

    from physic_core.body import load_body
    from physic_core.body.bones import rotations_from_parameters

    with torch.no_grad():
        out = load_body("embedded")(
            rotations_from_parameters(p), torch.from_numpy(p.betas), torch.from_numpy(p.transl)
        )
    pelvis = out.joints[:, 0].numpy()
    return {"transl": (p.transl + move(pelvis) - pelvis).astype(np.float32)}


altered(
    RightBodies,
    "an unknown body",
    "bodies_can_be_posed",
    lambda a, *_: replace(a, body_model="mhr"),
)
altered(
    RightBodies,
    "degrees",
    "bodies_can_be_posed",
    of_parameters(lambda p: {"body_pose": np.degrees(p.body_pose)}),
)
altered(RightBodies, "an OpenGL camera", "bodies_are_in_front", of_parameters(opengl))
altered(
    RightBodies,
    "centimetres",
    "bodies_are_as_far_away",
    of_parameters(lambda p: placed(p, lambda pelvis: 100 * pelvis)),
)
altered(
    RightBodies,
    "the frame of the crop",
    "bodies_are_in_place",
    of_parameters(lambda p: placed(p, lambda pelvis: pelvis + np.array([1.5, 0, 0]))),
)
restless(
    RightBodies,
    "hints that are there",
    "works_without_hints",
    lambda image, people, intrinsics, keypoints, hints: hints.floor is None,
    AttributeError("'NoneType' object has no attribute 'normal'"),
)
altered(
    RightBodies,
    "observed inverted",
    "observed_is_true_in_sight",
    lambda a, *_: replace(a, observed=None if a.observed is None else ~a.observed),
)
altered(
    RightHands,
    "degrees",
    "angles_are_radians",
    lambda a, *_: replace(a, rotvecs=np.degrees(a.rotvecs)),
)
altered(
    RightContact,
    "another mesh",
    "mesh_is_known",
    lambda a, *_: replace(a, topology="smplx"),
)


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


@wrong("zero in the sky", "accepts_or_refuses_any_photo")
class ZeroInTheSky(RightMetricDepth):
    def infer(self, image, hints):
        answer = super().infer(image, hints)
        return replace(answer, depth=np.where(np.isfinite(answer.depth), answer.depth, 0))
