"""The smallest result that has everything: two people of four vertices, a floor, a lens, checks and
stages.
"""

from __future__ import annotations

import numpy as np

from physic_core.types import (
    BodyContact,
    BodyParameters,
    CheckResult,
    ContactPartner,
    Grade,
    Intrinsics,
    Lens,
    Person,
    Plane,
    Provenance,
    Reconstruction,
    Scene,
    StageRecord,
    Support,
    SupportState,
    UnposedPerson,
)

HEIGHT = 6
WIDTH = 8
PARTNERS = (ContactPartner("floor", "rug"), ContactPartner("person", person=1, part="left_hand"))


def tiny_result(seed=0):
    """Return a result; another seed gives other numbers in every array, and other shapes."""
    rng = np.random.default_rng(seed)
    camera = Intrinsics.from_focal(10.0 + seed, WIDTH, HEIGHT, "EXIF: 50 mm")
    depth = rng.uniform(2, 5, (HEIGHT, WIDTH)).astype(np.float32)
    x = (np.arange(WIDTH) - camera.cx) / camera.fx
    y = (np.arange(HEIGHT) - camera.cy) / camera.fy
    scene = Scene(
        points=np.stack([depth * x, depth * y[:, None], depth], -1).astype(np.float32),
        normals=np.tile(np.float32([0, 0, -1]), (HEIGHT, WIDTH, 1)),
        colors=rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8),
        valid=rng.random((HEIGHT, WIDTH)) < 0.8,
        floor=Plane(np.array([0.0, -1.0, 0.0]), 1.4 + seed),
        floor_points=rng.normal(size=(3 + seed % 5, 3)).astype(np.float32),
        scale=1.0625,
        scale_sigma=0.07,
    )
    backend = Provenance(
        "segmenter", "mock", "physic_mock", "physic-mock", "0.1.0", {"limit": float("inf")}, "MIT"
    )
    return Reconstruction(
        image=rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8),
        intrinsics=camera,
        scene=scene,
        people=tuple(_person(rng) for _ in range(2)),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        body_model="embedded",
        skeleton="coco17",
        stages=(
            StageRecord("people", 0.25, 1.5, backend),
            StageRecord("joint", 1 / 3, cached=True),
        ),
        diagnostics={"joint": {"contact": [12.5, 0.1], "lowest": float("-inf"), "seed": seed}},
        warnings=("The focal length is a default – “0.95” of the long side.",),
        notes=("read from a file",),
        config={"engine": {"joint": {"steps": 100, "weight": 0.3}}},
        checks=(
            CheckResult("floor", "ok", 0.4, 0.15, "at least", "share", "of the pixels"),
            CheckResult("lean", "unknown", None, 12.0, "at most", "deg", "no floor", 0),
        ),
        photo="pixels-sha256:0",
        grade=Grade.DOUBTFUL,
        contact_partners=PARTNERS,
        lens=Lens(camera, (0.1, -0.01, 0.0, 0.0, 0.0)),
        unposed=(UnposedPerson((1.0, 1.0, 3.0, 4.0), 0.5, "no pose fits the box"),),
    )


def _person(rng):
    sizes = {
        "global_orient": 3,
        "body_pose": 63,
        "left_hand_pose": 45,
        "right_hand_pose": 45,
        "jaw_pose": 3,
    }
    sizes |= {"leye_pose": 3, "reye_pose": 3, "betas": 4, "expression": 0, "transl": 3}

    def numbers(*shape):
        return rng.normal(size=shape).astype(np.float32)

    return Person(
        box=np.float32([1, 0, 6, 5]),
        score=float(rng.random()),
        mask=rng.random((HEIGHT, WIDTH)) < 0.5,
        keypoints=numbers(17, 2),
        keypoint_confidence=rng.random(17).astype(np.float32),
        parameters=BodyParameters(**{name: numbers(1, size) for name, size in sizes.items()}),
        vertices=numbers(4, 3),
        joints=numbers(55, 3),
        contact=rng.random(4) < 0.5,
        distance=np.float32([0.1, -0.01, np.inf, 0.05]),
        contact_probability=rng.random(4).astype(np.float16),
        contact_partner=np.int16([-1, 0, 1, -1]),
        contacts=(BodyContact("left_hand", PARTNERS[1], 0.75, 1),),
        support=Support(
            SupportState.ASSUMED,
            (BodyContact("seat", PARTNERS[0], None, 4),),
            None,
            (0.5, 0.25, 3.0),
        ),
        failed_checks=("support",),
        unknown_checks=("lean",),
        grade=Grade.DOUBTFUL,
    )
