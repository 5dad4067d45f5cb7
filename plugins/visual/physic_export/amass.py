"""SMPL-X parameters as an AMASS npz: one frame per person, as Blender's SMPL-X add-on and AMASS
tools read it.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core import ExportedFiles, ExportRequest
from physic_core.errors import InputError
from physic_core.files import write_arrays
from physic_core.geometry import rotmat_to_rotvec, rotvec_to_rotmat_numpy
from physic_core.types import Bodies, BodyParameters, ContactProbability
from physic_visual.rig import body_of_result, pose_rig

if TYPE_CHECKING:
    from physic_core.body import BodyArrays
    from physic_core.export import ExportFrame
    from physic_core.types import AnyArray, BoolArray, Float64Array

_FRAMES = 2
"""Equal frames: readers that interpolate or differentiate refuse one."""

_FRAME_RATE = 30.0
"""Frames per second of the one frame; Blender's add-on refuses less than its target rate, 30 by
default.
"""

_PIVOT = (
    "trans is added after posing, and the root turns about the pelvis joint of the shaped body in "
    "its rest pose (array pelvis): the pelvis is at pelvis + trans"
)


def export_amass(request: ExportRequest) -> ExportedFiles:
    """Return one npz per person, with the keys of AMASS and what they mean in words.

    Embedded bodies are fitted with SMPL-X on their surface; the error is in the file
    (``fit_error_m``) and the notes.

    Raises:
        InputError: no SMPL-X file is given.
        BodyModelError: the file is not an SMPL-X model.
    """
    file = _smplx_file(request)
    model, parameters, contact, errors = _smplx_parameters(request, file)
    gender = _body_gender(file)
    files = {}
    notes = []
    for row, index in enumerate(request.person):
        error = errors[row]
        arrays = _amass_arrays(model, parameters[row : row + 1], request.frame, gender)
        arrays["fit_error_m"] = np.array(error)
        arrays["contact"] = contact[row]
        stream = io.BytesIO()
        write_arrays(stream, arrays)
        files[request.file_of(index)] = stream.getvalue()
        if error > 0:
            notes.append(
                f"person {index}: fitted with SMPL-X, surface within {1000 * error:.0f} mm on "
                f"average"
            )
    notes.append(
        f"frame: {request.frame.axes}; the root turns about the pelvis joint; gender {gender}, "
        f"from the file"
    )
    return ExportedFiles(files, tuple(notes))


def _smplx_file(request: ExportRequest) -> Path:
    """Return the path of the SMPL-X file.

    Raises:
        InputError: none is given, and the result's configuration names none.
    """
    named = request.body_file or (request.result.config.get("body_model") or {}).get("path")
    if not named:
        raise InputError(
            "AMASS files hold SMPL-X parameters, and their meaning is in the SMPL-X model file, "
            "which PhySIC may not ship: give the path of your SMPLX_NEUTRAL.npz, SMPLX_MALE.npz or "
            "SMPLX_FEMALE.npz (--body-model FILE, or body_model= in Python). The file is free for "
            "research from the SMPL-X project, after registration. Without it, --to glb and --to "
            "bvh have the same pose"
        )
    return Path(named)


def _smplx_parameters(
    request: ExportRequest, file: Path
) -> tuple[BodyArrays, BodyParameters, BoolArray, Float64Array]:
    """Return the SMPL-X model, of the chosen people the parameters in the camera frame and the
    vertices in contact (N, V), and fit errors in metres.
    """
    from physic_core.body import (
        build_body_model,
        load_body,
        rest_mesh_of_model,
        smplx_arrays,
    )
    from physic_core.conversion import convert_bodies, convert_contact

    people = [person.parameters for _, person in request.chosen()]
    stacked = BodyParameters(
        **{name: np.concatenate([getattr(p, name) for p in people]) for name in vars(people[0])}
    )
    touched = np.stack([person.contact for _, person in request.chosen()])
    if request.result.body_model == "smplx":
        model = body_of_result(request.result, file)
        for _, person in request.chosen():
            pose_rig(model, person, request.frame)  # checks that the file is that of the result
        return model, stacked, touched, np.zeros(len(people))
    if request.result.body_model != "embedded":
        raise InputError(
            f"bodies of the model '{request.result.body_model}' cannot be converted to SMPL-X"
        )
    model = smplx_arrays(file)
    body = build_body_model(model)
    converted = convert_bodies(Bodies(stacked, "embedded"), body)
    errors = converted.joints_m if converted.surface_m is None else converted.surface_m
    rest = rest_mesh_of_model(load_body("embedded"))
    probability = ContactProbability(touched.astype(np.float32), rest.topology, rest)
    contact = convert_contact(probability, body).probability > 0.5
    return model, converted.bodies.parameters, contact, errors


def _amass_arrays(
    model: BodyArrays, person: BodyParameters, frame: ExportFrame, gender: str
) -> dict[str, AnyArray]:
    """Return the arrays of the file of one person."""
    shape = np.concatenate([person.betas[0], person.expression[0]]).astype(np.float64)
    pelvis = model.rest_joints(shape)[0]
    turn = frame.from_camera[:3, :3]
    shift = frame.from_camera[:3, 3]
    orient = rotmat_to_rotvec(
        turn @ rotvec_to_rotmat_numpy(person.global_orient.astype(np.float64))
    )
    # The pelvis joint moves to where the frame has it; trans is what is left after the rest
    # position.
    trans = (person.transl[0].astype(np.float64) + pelvis) @ turn.T + shift - pelvis
    eyes = np.concatenate([person.leye_pose, person.reye_pose], 1)
    hands = np.concatenate([person.left_hand_pose, person.right_hand_pose], 1)
    frames = {
        "poses": np.concatenate([orient, person.body_pose, person.jaw_pose, eyes, hands], 1),
        "root_orient": orient,
        "pose_body": person.body_pose,
        "pose_jaw": person.jaw_pose,
        "pose_eye": eyes,
        "pose_hand": hands,
        "trans": trans[None],
        "expression": person.expression,
        "expressions": person.expression,  # the name that Blender's add-on for SMPL-X reads
    }
    return {
        **{
            name: np.repeat(values.astype(np.float64), _FRAMES, axis=0)
            for name, values in frames.items()
        },
        "betas": person.betas[0].astype(np.float64),
        "num_betas": np.array(person.betas.shape[1]),
        "gender": np.array(gender),
        "surface_model_type": np.array("smplx"),
        "mocap_frame_rate": np.array(_FRAME_RATE),
        "mocap_time_length": np.array(_FRAMES / _FRAME_RATE),
        "pelvis": pelvis,
        "pivot": np.array(_PIVOT),
        "frame": np.array(f"{frame.axes}; meters; hands are relative to flat hands"),
    }


def _body_gender(file: Path) -> str:
    """Return the gender that the name of the model file states; neutral if it states none."""
    name = file.stem.lower()
    return next((gender for gender in ("female", "male") if gender in name), "neutral")
