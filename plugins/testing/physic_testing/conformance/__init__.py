"""Conformance kit: checks that a backend fulfils its interface, run on synthetic photos with ground
truth.

From Python, in a test, and in a shell::

    report = check_backend(MyDepth)          # or a name: check_backend("my-depth")
    print(report.text); report.raise_if_failed()

    @parametrize_with_checks("metric_depth", "my-depth")
    def test_conformance(check):
        check()

    physic plugins check my-depth [--json]

A backend class may define two attributes that only this kit reads: ``capabilities``, a collection
of keys of :data:`CAPABILITIES`, and ``conformance_options(world)``, a static method that returns
the backend's options for the photo of a world. A backend that needs prompts, such as points on
people, defines the second one.

The checks test the contract: shapes, dtypes, frames, units, rough agreement with the truth of
simple synthetic photos, and bias: over six photos of people, no shift, scale, rotation, mirroring
or other order may bring the output clearly closer to the truth. A mean error counts beyond three
standard errors, so that large errors that point nowhere pass. Only the capability "exact" limits
how large an error is.
"""

from __future__ import annotations

from physic_testing.conformance.backend_under_test import CAPABILITIES
from physic_testing.conformance.check import Check
from physic_testing.conformance.contract import violations
from physic_testing.conformance.kit import check_backend, checks_for, parametrize_with_checks
from physic_testing.conformance.report import Report, Result

__all__ = [
    "CAPABILITIES",
    "Check",
    "Report",
    "Result",
    "check_backend",
    "checks_for",
    "parametrize_with_checks",
    "violations",
]
