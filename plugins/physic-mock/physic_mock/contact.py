"""Mock of a contact prior: misses patches of true contact and adds false patches."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.types import Bodies, ContactProbability
from physic_mock.noise import seeded_rng, smooth_field
from physic_mock.recognition import MockOptions, match_masks_to_world, recognise_world

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, People, UInt8Array
    from physic_testing.worlds import World

_FEWEST = 60  # vertices: whoever touches less gets made-up contact as if they touched this much
_FARTHEST = 3.0  # patches: beyond, the scene's distance tempts no less


class ContactOptions(MockOptions):
    """Options of :class:`MockContactPrior`.

    ``noise`` is the power to which both shares are raised: 0 finds all and makes up nothing, 2 squares them.
    """

    VERSION_4: ClassVar = {"fixed_parts": True}

    fixed_parts: bool = Field(
        False,
        description="Whether the same parts of every body are returned instead, whatever touches: soles, and with half "
        "the probability the rest of feet, hands and, of who sits or lies, thighs, buttocks and back; only where their "
        "joints are reported as observed. Unused with noise 0.",
    )

    recall: float = Field(
        0.35, gt=0, le=1, description="Share of the true contact vertices that are found, on average."
    )
    precision: float = Field(0.41, gt=0, le=1, description="Share of the found vertices that are true, on average.")
    spread: float = Field(
        0.4,
        ge=0,
        lt=1,
        description="How unlike people fare: standard deviation of a person's recall as a share of the largest one "
        "possible, and of their made-up contact as a share of its mean.",
    )
    patch_m: float = Field(0.15, ge=1e-6, le=1e3, description="Size of the patches that are missed or made up, metres.")
    lure: float = Field(
        1.0,
        ge=0,
        le=10,
        description="How much rather soles, hands, back, seat and thighs are made up than other parts; 0 not at all.",
    )


class MockContactPrior(interfaces.ContactPrior):
    """Contact prior that returns a world's contact with missed patches and false patches near the scene."""

    Options = ContactOptions
    options: ContactOptions

    def infer(self, image: UInt8Array, people: People, bodies: Bodies) -> ContactProbability:
        """Return contact probabilities (N, V) for people of a world's photo, above 0.5 for predicted contact.

        The mesh is that of the world; ``rest`` is set for bodies of another model.

        Raises:
            BackendError: the image shows no world, or a person is nobody of it.
        """
        from physic_core.body import load_body
        from physic_core.body.convert.bodies import rest_mesh_of_model

        found = recognise_world(image)
        rows = match_masks_to_world(found, people)
        if self.options.fixed_parts and self.options.noise > 0 and bodies.body_model == found.world.body_model:
            return ContactProbability(_fixed_parts(found.world, bodies), found.world.topology)
        every = np.stack([_probability(found.world, i, self.options) for i in range(len(found.world.vertices))])
        rest = (
            None
            if bodies.body_model == found.world.body_model
            else rest_mesh_of_model(load_body(found.world.body_model))
        )
        return ContactProbability(every[rows], found.world.topology, rest)


def _probability(world: World, person: int, options: ContactOptions) -> FloatArray:
    """Return the contact probability (V,) of one person."""
    rng = seeded_rng(world, options.noise_seed, f"contact of person {person}")
    recall, precision = options.recall**options.noise, options.precision**options.noise
    fares = seeded_rng(world, options.noise_seed, f"how the contact of person {person} fares")
    share, excess = _draw_recall(recall, options.spread, fares)
    field = smooth_field(world.vertices[person].astype(np.float64), options.patch_m, rng)
    true = np.flatnonzero(world.contact[person])
    others = np.flatnonzero(~world.contact[person] & world.outer)
    hits = true[np.argsort(-field[true])][: round(share * len(true))]
    wrong = round(excess * recall * max(len(true), _FEWEST) * (1 - precision) / precision)
    nearness = -np.minimum(world.distance[person, others] / options.patch_m, _FARTHEST)
    temptation = field[others] + nearness + options.lure * _contact_prone_vertices(world.body_model)[others]
    false = others[np.argsort(-temptation)][:wrong]
    # Surest in the middle of a patch, and of what is true rather than of what is made up.
    probability = 0.45 / (1 + np.exp(1 - field)) * rng.uniform(0.7, 1.0, len(field))
    probability[hits] = np.linspace(0.95, 0.55, len(hits))
    probability[false] = np.linspace(0.85, 0.52, len(false))
    rounded: FloatArray = np.round(probability, 6)  # exp() differs in its last bit between CPUs
    return rounded


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
    """Return the contact probability (N, V) of fixed body parts of people whose joints are observed."""
    from physic_core.body import load_body
    from physic_core.body.joints import JOINT_INDEX

    model = load_body(world.body_model)
    probability = np.zeros((len(bodies.parameters), model.num_vertices), np.float32)
    hips = bodies.parameters.body_pose.reshape(-1, 21, 3)[:, :2]
    bent = np.linalg.norm(hips, axis=-1).mean(1) > _BENT_HIPS
    seen = np.ones((len(bodies.parameters), len(JOINT_INDEX)), bool) if bodies.observed is None else bodies.observed
    for name, (value, joints) in _FIXED_PARTS.items():
        rows = model.contact_sets[name].numpy()
        shown = seen[:, [JOINT_INDEX[joint] for joint in joints]].any(1)
        for i in np.flatnonzero(shown & (bent if name in _SEAT else True)):
            probability[i, rows] = np.maximum(probability[i, rows], value)
    return probability


def _draw_recall(recall: float, spread: float, rng: np.random.Generator) -> tuple[float, float]:
    """Draw a person's recall (beta distributed) and a factor of mean 1 on the false contact."""
    if spread == 0 or recall == 1:
        return recall, 1.0
    strength = 1 / spread**2 - 1
    return rng.beta(recall * strength, (1 - recall) * strength), rng.gamma(1 / spread**2, spread**2)


@lru_cache(maxsize=2)
def _contact_prone_vertices(body_model: str) -> BoolArray:
    """Return the vertices (V,) bool of body parts that often touch something."""
    from physic_core.body import load_body

    model = load_body(body_model)
    often = np.zeros(model.num_vertices, bool)
    for name in ("left_sole", "right_sole", "left_hand", "right_hand", "back", "gluteus", "thighs"):
        often[model.contact_sets[name].numpy()] = True
    return often
