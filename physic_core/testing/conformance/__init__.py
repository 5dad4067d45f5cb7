"""The conformance kit: what every backend of an interface must do, tried on worlds with ground truth."""

from __future__ import annotations

from physic_core.testing.conformance.kit import check_backend, checks_for, parametrize_with_checks
from physic_core.testing.conformance.report import Report, Result
from physic_core.testing.conformance.run import Check
from physic_core.testing.conformance.subject import CAPABILITIES

__all__ = ["CAPABILITIES", "Check", "Report", "Result", "check_backend", "checks_for", "parametrize_with_checks"]
