"""Mock of a contact prior: the true contact, or the same parts of every body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core import interfaces
from physic_core.types import Bodies, ContactProbability
from physic_mock.recognition import MockOptions, match_masks_to_world, recognise_world

if TYPE_CHECKING:
    from physic_core.types import FloatArray, People, UInt8Array
    from physic_testing.worlds import World

_TOUCHES = 0.95  # probability of true contact without noise


class MockContactPrior(interfaces.ContactPrior):
    """Contact prior that returns a world's contact.

    With noise it returns the same parts of every body, whatever touches: soles, and with half the
    probability the rest of feet, hands and, of people who sit or lie, thighs, buttocks and back;
    only where their joints are reported as observed.
    """

    written_for = 1
    Options = MockOptions
    options: MockOptions

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Return contact probabilities (N, V) for people of a world's photo, above 0.5 for
        predicted contact.

        The mesh is that of the world; ``rest`` is set for bodies of another model.

        Raises:
            BackendError: the image shows no world, or a person is not in it.
        """
        from physic_core.body import load_body, rest_mesh_of_model

        recognised = recognise_world(image)
        rows = match_masks_to_world(recognised, people)
        world = recognised.world
        probability = np.where(world.contact[rows], _TOUCHES, 1 - _TOUCHES)
        if self.options.noise:
            probability = _fixed_parts(world, bodies)
        is_own = bodies.body_model == world.body_model
        rest = None if is_own else rest_mesh_of_model(load_body(world.body_model))
        return ContactProbability(probability.astype(np.float32), world.topology, rest)


_FIXED_PARTS = {
    "left_foot": (0.5, ("left_ankle", "left_foot")),
    "right_foot": (0.5, ("right_ankle", "right_foot")),
    "left_hand": (0.5, ("left_wrist",)),
    "right_hand": (0.5, ("right_wrist",)),
    "thighs": (0.5, ("left_knee", "right_knee", "left_hip", "right_hip")),
    "gluteus": (0.5, ("left_hip", "right_hip")),
    "back": (0.5, ("left_shoulder", "right_shoulder")),
    "left_sole": (1.0, ("left_ankle", "left_foot")),
    "right_sole": (1.0, ("right_ankle", "right_foot")),
}
"""Contact set -> probability, and joints of which one must be observed."""

_SEAT = ("thighs", "gluteus", "back")
_BENT_HIPS = 0.7  # radians


def _fixed_parts(world: World, bodies: Bodies) -> FloatArray:
    """Return the contact probability (N, V) of fixed body parts of people whose joints are
    observed.
    """
    from physic_core.body import JOINT_INDEX, load_body

    model = load_body(world.body_model)
    count = len(bodies.parameters)
    probability = np.zeros((count, model.num_vertices), np.float32)
    hips = bodies.parameters.body_pose.reshape(-1, 21, 3)[:, :2]
    bent = np.linalg.norm(hips, axis=-1).mean(1) > _BENT_HIPS
    is_observed = bodies.observed
    if is_observed is None:
        is_observed = np.ones((count, len(JOINT_INDEX)), bool)
    for name, (value, joints) in _FIXED_PARTS.items():
        is_shown = is_observed[:, [JOINT_INDEX[joint] for joint in joints]].any(1)
        part = np.ix_(
            is_shown & bent if name in _SEAT else is_shown, model.contact_sets[name].numpy()
        )
        probability[part] = np.maximum(probability[part], value)
    return probability
