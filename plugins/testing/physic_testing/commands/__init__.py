"""Commands that metricbody-testing adds to ``physic``."""
