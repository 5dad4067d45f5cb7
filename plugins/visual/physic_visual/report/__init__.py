"""A self-contained page of one reconstruction, ``report.html``."""
