"""The method of the paper, one photo at a time: call the backends, validate their results, run the engine, check."""
