"""The pipeline for one photo: call the backends, validate their results, run the engine, run the self-checks."""
