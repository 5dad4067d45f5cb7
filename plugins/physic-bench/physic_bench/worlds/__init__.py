"""The engine on synthetic worlds: rows of the ablation table, and their results."""
