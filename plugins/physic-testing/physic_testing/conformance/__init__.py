"""The conformance kit: what every backend of an interface must do, tried on worlds with ground truth.

From Python, in a test, and in a shell::

    report = check_backend(MyDepth)          # or a name: check_backend("my-depth")
    print(report.text); report.raise_if_failed()

    @parametrize_with_checks("metric_depth", "my-depth")
    def test_conformance(check):
        check()

    physic plugins check my-depth [--json]
    physic plugins compare metric_depth my-depth embedded

A backend class may say more of itself, by two attributes that nothing but this kit reads: ``capabilities``, a
collection of words of :data:`CAPABILITIES`, and ``conformance_options(world)``, a static method that returns the
options with which it is to be tried on the photo of a world, for a backend that has to be pointed at something.

Checks ask for the contract: forms, frames, units, and answers not far from the truth of plain synthetic photos. How
good a backend is they report and never judge.
"""

from __future__ import annotations

from physic_testing.conformance.asking import violations
from physic_testing.conformance.check import Check
from physic_testing.conformance.kit import check_backend, checks_for, parametrize_with_checks
from physic_testing.conformance.report import Report, Result
from physic_testing.conformance.subject import CAPABILITIES

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
