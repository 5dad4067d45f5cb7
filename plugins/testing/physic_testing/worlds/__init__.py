"""Synthetic photos of people with ground truth for all estimates of PhySIC."""

from physic_testing.worlds.skeletons import BLAZEPOSE, SKELETONS
from physic_testing.worlds.world import WORLDS, World, load_world, world_of

__all__ = ["BLAZEPOSE", "SKELETONS", "WORLDS", "World", "load_world", "world_of"]
