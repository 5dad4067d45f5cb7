"""Surface energies by the equations of the terms, one operation after another: the slow twin of the
fused ones.
"""

from __future__ import annotations

from functools import partial

import torch

from physic_core.engine.joint.sampling import root_relative
from physic_core.engine.joint.terms.picture import MIN_DEPTH_M
from physic_core.engine.joint.terms.scene import SLACK_M, lowest_height
from physic_core.geometry.robust import robust_loss
from physic_paper.terms.printed_regularisation import mesh_energies


def rho_of(total):
    """Return the robust loss of a sum, of squared residuals in units of its expected residual."""
    return partial(robust_loss, total.kind, c=total.scale)


def contact_energy(squared, weight, rho):
    """Return L_c (Eq. 6) of each person (B,): ``sum_v w_v rho(d_v^2)``, on either side of the
    surface.

    Args:
        squared: (B, V) squared distance to the scene or the floor, in units of its expected error.
        weight: (B, V): weights of contact vertices near a surface; 0 for the others.
        rho: robust loss; a redescending one ignores far contacts.
    """
    return (weight * rho(squared)).sum(-1)


def depth_energy(
    z,
    log_map_depth,
    weight,
    log_scale,
    offset,
    sigma,
    rho,
):
    """Return L_d (Eq. 4) per pixel and person: ``mean_v rho((log z_v - log(s d_v) - o)^2 /
    sigma^2)``, (B,).

    The mean does not depend on the resolution. It is 0 for a person without vertices.

    Args:
        z: (B, V) depth of the vertices, metres.
        log_map_depth: (B, V) logarithm of the depth map at their pixels, finite.
        weight: (B, V), 0 for vertices without a depth.
        log_scale: () of the scene, or (B, 1); the depth map scales with it.
        offset: (B,) log of the ratio between the depth map at the person and the scene's depth.
        sigma: expected difference between the logarithms.
    """
    residual = (
        z.clamp(min=MIN_DEPTH_M).log() - log_map_depth - log_scale - offset[:, None]
    ) / sigma
    total = (weight * rho(residual.square())).sum(-1)
    return total / weight.sum(-1).clamp(min=1e-9)


def penetration_energy(signed, weight, slack, sigma, rho):
    """Return L_i (Eq. 7) by signed distance, (B,): ``sum_v w_v rho(max(0, -d_v - slack)^2 /
    sigma^2)``.

    Args:
        signed: (B, V) metres, negative inside.
        weight: (B, V), 0 for vertices that are skipped.
        slack: depth without a penalty, metres.
        sigma: expected error of the surface, metres.
    """
    depth = torch.relu(-signed - slack) / sigma
    return (weight * rho(depth.square())).sum(-1)


def reference_surface_energies(
    data,
    vertices,
    pelvis,
    root,
    log_scale,
    offset,
):
    """Arguments and result as of ``surface_energies``."""
    scale = log_scale.exp()[:, None]
    zero = torch.zeros_like(offset)
    on = {term.name: (term, total) for term, total in data.terms}
    energies = {}
    signed = height = torch.zeros_like(data.plane_distance)
    if data.normals is not None:
        signed = (data.normals.transpose(1, 2) * vertices).sum(-1) / scale - data.plane_distance
    if data.floor is not None:
        height = (vertices @ data.floor.normal + data.floor.offset * scale) / scale
    if "depth" in on:
        term, s = on["depth"]
        mean = depth_energy(
            vertices[..., 2],
            term.log_map_depth,
            s.weight,
            log_scale[:, None],
            offset,
            s.sigma,
            rho_of(s),
        )
        energies["depth"] = s.weight.sum(1) * mean
    if "contact" in on:
        term, s = on["contact"]
        distance = torch.where(term.on_scene, signed, height)
        energies["contact"] = contact_energy((distance / s.sigma).square(), s.weight, rho_of(s))
    if "penetration" in on:
        _, s = on["penetration"]
        energies["penetration"] = penetration_energy(signed, s.weight, SLACK_M, s.sigma, rho_of(s))
    if "floor" in on:
        term, s = on["floor"]
        # Invisible legs give the scale no gradient: they use the scale at the last refresh.
        invisible = (
            height * scale + data.floor.offset * (data.last_scale - scale)
        ) / scale.detach()
        above = torch.where(term.eligible, height, invisible)
        energies["floor"] = penetration_energy(above, s.weight, 0.0, s.sigma, rho_of(s))
    relative = root_relative(vertices, pelvis, root)
    energies["mesh"] = mesh_energies(relative, data.relative.transpose(1, 2), data.mesh_weight)
    lowest = [
        lowest_height(height.index_select(1, rows)) if len(rows) else zero for rows in data.soles
    ]
    assert list(energies) == [*on, "mesh"]
    return torch.stack(list(energies.values())), torch.stack(lowest, 1)
