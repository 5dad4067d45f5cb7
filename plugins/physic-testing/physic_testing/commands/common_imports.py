"""Imports what most backends import; processes that are copied from one that has done so need not do it again."""

from contextlib import suppress

with suppress(Exception):  # a package that cannot be imported is reported by the backends that need it
    import torch  # noqa: F401

    import physic_testing.conformance  # noqa: F401
