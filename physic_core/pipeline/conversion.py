"""Convert bodies, hands and contact probabilities of backends to the configured body model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError
from physic_core.interfaces.body_estimator import valid_body_rows

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_core.types import Bodies, ContactProbability, Hands


def replace_hands(bodies: Bodies, hands: Hands, model: BodyModel) -> Bodies:
    """Replace the finger rotations of bodies by those of ``hands`` where their confidence is above 0.

    If ``hands.wrists`` are given, forearms and wrists are rotated to fit the hands, weighted by confidence.
    """
    if hands.wrists is not None:
        from physic_core.body.attach_hands import WRIST_RANGE, attach_hands

        return replace(bodies, parameters=attach_hands(bodies.parameters, hands, model, WRIST_RANGE))
    p, found = bodies.parameters, hands.confidence > 0
    flat = hands.rotvecs.reshape(len(p), 2, 45).astype(p.left_hand_pose.dtype)
    left = np.where(found[:, :1], flat[:, 0], p.left_hand_pose)
    right = np.where(found[:, 1:], flat[:, 1], p.right_hand_pose)
    return replace(bodies, parameters=replace(p, left_hand_pose=left, right_hand_pose=right))


def convert_to_configured(bodies: Bodies, model: BodyModel, who: str, stages: StageRunner) -> Bodies:
    """Convert bodies to the configured body model, and add a note with the conversion error.

    Raises:
        BodyModelError: the bodies have neither joints nor mesh, or too few joints for all people.
    """
    from physic_core.body.convert.bodies import can_convert, convert_with_residuals
    from physic_core.cache.correspondences import cached_correspondence

    if not can_convert(bodies, model):
        cure = "name = 'embedded'" if bodies.body_model == "embedded" else f"path = the file of a '{bodies.body_model}'"
        raise BodyModelError(
            f"{who} gives bodies for the body model '{bodies.body_model}', "
            f"but the configuration loads '{model.name}': set [body_model] {cure}, "
            f"or choose a body_estimator that gives '{model.name}'"
        )
    try:
        found = convert_with_residuals(bodies, model, cached_correspondence)
    except BodyModelError as error:
        raise BodyModelError(f"{who}: {error}") from error
    if not valid_body_rows(found.bodies).any():
        raise BodyModelError(
            f"{who} gives bodies for the body model '{bodies.body_model}' with too few joints to convert them to "
            f"'{model.name}': both hips, and both shoulders or the neck, are needed for at least one person"
        )
    stages.note(found.note(bodies.body_model))
    return found.bodies


def transfer_contact(
    contact: ContactProbability, model: BodyModel, who: str, stages: StageRunner
) -> ContactProbability | None:
    """Transfer contact probabilities to the mesh of the configured body model; None and a warning on failure."""
    from physic_core.body.convert.bodies import convert_contact
    from physic_core.cache.correspondences import cached_correspondence

    try:
        carried = convert_contact(contact, model, cached_correspondence)
    except BodyModelError as error:
        stages.warn(f"{who}: {error}; contact is computed from distances only")
        return None
    stages.note(f"contact transferred from the mesh '{contact.topology}' to '{model.topology}'")
    return carried


def bodies_for_backends(bodies: Bodies, model: BodyModel) -> Bodies:
    """Add joints to bodies for other backends, unless all backends can load the body model ("embedded")."""
    if model.name == "embedded":
        return bodies
    from physic_core.body.convert.bodies import replace_mesh_with_joints

    return replace_mesh_with_joints(bodies, model)
