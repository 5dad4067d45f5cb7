"""Energies of the publications: the paper as printed, the code as released, and PROX, the paper's baseline."""
