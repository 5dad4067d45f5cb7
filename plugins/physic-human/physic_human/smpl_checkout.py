"""Base classes of backends that run a checkout and need the user's SMPL file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_human.checkout_backend import CheckoutBackend, CheckoutOptions
from physic_human.user_smpl import smpl_missing, smpl_requirement

if TYPE_CHECKING:
    from physic_core.interfaces import Requirement


class SmplCheckoutOptions(CheckoutOptions):
    """Settings of a backend that runs a checkout and reads a SMPL file."""

    smpl_file: str


class SmplCheckoutBackend(CheckoutBackend):
    """Base class of a backend that runs a checkout and reads the file of its option ``smpl_file``."""

    options: SmplCheckoutOptions

    def missing(self) -> tuple[str, ...]:
        """Describe missing checkout, packages, weights and SMPL file."""
        return (*super().missing(), *smpl_missing(self.options.smpl_file))

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the repository, its packages, and the SMPL file."""
        return (*super().requirements(), smpl_requirement(self.options.smpl_file))
