"""Worlds: synthetic scenes of people in rooms and outdoors, with the truth of everything that PhySIC estimates."""

from physic_testing.worlds.skeletons import BLAZEPOSE, SKELETONS
from physic_testing.worlds.world import CONTACT_DISTANCE, WORLDS, World, benchmark_worlds, build_world

__all__ = ["BLAZEPOSE", "CONTACT_DISTANCE", "SKELETONS", "WORLDS", "World", "benchmark_worlds", "build_world"]
