"""The kit over everything that is installed."""
