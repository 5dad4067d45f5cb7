"""What the engine reaches on worlds with ground truth, and how fast: ``physic bench``."""
