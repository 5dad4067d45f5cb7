"""Templates of a new plugin: one example backend for each interface, which passes the conformance
kit.

:mod:`physic_testing.scaffold.package` writes a template under the names of the new plugin.
"""
