"""Weighted sums of robust losses, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physic_core.geometry.robust import loss_with_slope, robust_loss


@dataclass(frozen=True)
class RobustSum:
    """Weighted sum of robust losses, ``sum_v w_v rho(r_v^2 / sigma^2)``, of residuals (B, n) or (p,).

    Attributes:
        kind: of loss, see :mod:`physic_core.geometry.robust`.
        scale: of the loss, in sigmas.
        sigma: expected residual.
        weight: (B, n).
        value_weight: (B, n) weights of the values of the loss of unit scale.
        slope_weight: (B, n) weights of its derivatives.
    """

    kind: str
    scale: float
    sigma: float
    weight: Tensor
    value_weight: Tensor
    slope_weight: Tensor

    @classmethod
    def of(cls, kind: str, scale: float, sigma: float, weight: Tensor) -> RobustSum:
        """Build from the type of loss, its scale in units of ``sigma``, the expected residual and weights (B, n)."""
        return cls(kind, scale, sigma, weight, weight * scale**2, weight * (2.0 / sigma**2))

    def rho(self, squared: Tensor) -> Tensor:
        """Return the robust loss of squared residuals ``r^2 / sigma^2``, differentiable."""
        return robust_loss(self.kind, squared, self.scale)

    def value_and_slope(self, residual: Tensor) -> tuple[Tensor, Tensor]:
        """Return the sum of each person (B,) and its derivative with respect to the residuals (B, n)."""
        values, slopes = self.values_and_slopes(residual)
        return values.sum(1), slopes

    def values_and_slopes(self, residual: Tensor) -> tuple[Tensor, Tensor]:
        """Return the summands (...) and their derivatives with respect to the residuals (...)."""
        loss, slope = loss_with_slope(self.kind, (residual * (1.0 / (self.sigma * self.scale))).square(), self.scale)
        return self.value_weight * loss, self.slope_weight * residual * slope
