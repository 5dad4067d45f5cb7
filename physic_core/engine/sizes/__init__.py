"""Evidence of the size of people and scenes: soles, torsos, statures, and the sizes that the user knows.

:mod:`.evidence` states each kind as a logarithm of the scale with its sigma, and :mod:`.stature` is the prior of
people. :mod:`.known_sizes` and :mod:`.people_in_scene`, which compare with sizes of the user, are imported when some
are given.
"""

from physic_core.engine.sizes.own_depth import depth_witness, rescaled_depth
from physic_core.engine.sizes.person_scales import scales_by_soles, scales_by_torsos
from physic_core.engine.sizes.scale_vote import ScaleVote, Witnesses, scaled_depth, vote_on_scale
from physic_core.engine.sizes.stature import (
    ADULT_STATURE_M,
    adult_probability,
    adult_shape,
    betas_with_stature,
    linearise_stature,
    resize_bodies,
    size_sigmas,
    stature_prior,
    stature_sigmas,
)

__all__ = [
    "ADULT_STATURE_M",
    "ScaleVote",
    "Witnesses",
    "adult_probability",
    "adult_shape",
    "betas_with_stature",
    "depth_witness",
    "linearise_stature",
    "rescaled_depth",
    "resize_bodies",
    "scaled_depth",
    "scales_by_soles",
    "scales_by_torsos",
    "size_sigmas",
    "stature_prior",
    "stature_sigmas",
    "vote_on_scale",
]
