"""Begins a plugin: a package with one backend that passes the conformance kit, for its author to make it their own.

One module for each interface holds the backend that a new package starts with. They are plain guesses, and honest ones;
:mod:`physic_core.scaffold.package` writes their source under the new names.
"""
