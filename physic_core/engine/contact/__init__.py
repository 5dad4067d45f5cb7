"""Stage 4: contact of bodies with scene, people and objects, and what carries them (paper sec. 3.3)."""
