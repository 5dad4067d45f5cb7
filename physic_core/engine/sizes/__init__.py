"""Evidence of the size of people and scenes."""

from physic_core.engine.sizes.person_scales import scales_by_soles, scales_by_torsos, standing_scores

__all__ = ["scales_by_soles", "scales_by_torsos", "standing_scores"]
