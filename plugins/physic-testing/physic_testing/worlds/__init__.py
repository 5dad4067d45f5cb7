"""Synthetic scenes of people, indoors and outdoors, with ground truth for all estimates of PhySIC."""

from physic_testing.worlds.skeletons import BLAZEPOSE, SKELETONS
from physic_testing.worlds.world import CONTACT_DISTANCE, WORLDS, World, benchmark_worlds, build_world

__all__ = ["BLAZEPOSE", "CONTACT_DISTANCE", "SKELETONS", "WORLDS", "World", "benchmark_worlds", "build_world"]
