"""Imports what most backends import; processes that are copied from one that has done so need not
do it again.
"""

from contextlib import suppress

# a package that cannot be imported is reported by the backends that need it
with suppress(Exception):
    import torch  # noqa: F401

    import physic_testing.conformance  # noqa: F401
