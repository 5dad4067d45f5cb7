"""Synthetic scenes of people, indoors and outdoors, with ground truth for all estimates of
PhySIC.
"""

from physic_testing.worlds.skeletons import BLAZEPOSE, SKELETONS
from physic_testing.worlds.views import VIEWS, view_names
from physic_testing.worlds.world import (
    CHILD_WORLDS,
    CONTACT_DISTANCE,
    CONTACT_WORLDS,
    OTHER_BODIES,
    RAISED_FEET_WORLDS,
    WORLDS,
    World,
    benchmark_worlds,
    build_world,
    is_world,
    world_of,
)

__all__ = [
    "BLAZEPOSE",
    "CHILD_WORLDS",
    "CONTACT_DISTANCE",
    "CONTACT_WORLDS",
    "OTHER_BODIES",
    "RAISED_FEET_WORLDS",
    "SKELETONS",
    "VIEWS",
    "WORLDS",
    "World",
    "benchmark_worlds",
    "build_world",
    "is_world",
    "view_names",
    "world_of",
]
