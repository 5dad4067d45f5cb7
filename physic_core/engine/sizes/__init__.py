"""Evidence of the size of people and scenes: soles, torsos, statures, and the sizes that the user knows."""

from physic_core.engine.sizes.body_points import vertices_at_ray
from physic_core.engine.sizes.known_sizes import (
    BodyEnds,
    KnownDistances,
    KnownGeometry,
    KnownScene,
    scale_scene,
    scale_scene_to_known_sizes,
)
from physic_core.engine.sizes.people_in_scene import (
    CONTRADICTION,
    FACTOR_SPREAD,
    STATURES_M,
    size_by_scene,
    stature_factor,
)
from physic_core.engine.sizes.person_scales import scales_by_soles, scales_by_torsos, standing_scores
from physic_core.engine.sizes.scale_vote import PeopleVote, PersonScales, ScaleRule, scale_by_people
from physic_core.engine.sizes.stature import (
    ADULT_STATURE_M,
    STATURE_SIGMA,
    adult_shape,
    betas_with_stature,
    linearise_stature,
    resize_bodies,
    stature_prior,
    stature_sigmas,
)

__all__ = [
    "ADULT_STATURE_M",
    "CONTRADICTION",
    "FACTOR_SPREAD",
    "STATURES_M",
    "STATURE_SIGMA",
    "BodyEnds",
    "KnownDistances",
    "KnownGeometry",
    "KnownScene",
    "PeopleVote",
    "PersonScales",
    "ScaleRule",
    "adult_shape",
    "betas_with_stature",
    "linearise_stature",
    "resize_bodies",
    "scale_by_people",
    "scale_scene",
    "scale_scene_to_known_sizes",
    "scales_by_soles",
    "scales_by_torsos",
    "size_by_scene",
    "standing_scores",
    "stature_factor",
    "stature_prior",
    "stature_sigmas",
    "vertices_at_ray",
]
