"""Strength of the joints, and the gains of the position actuators of people in MJCF and URDF files.

Source: the torque limits and the ratio of the gains of the humanoid of X. B. Peng et al., DeepMimic, ACM Trans. Graph.
37.4 (2018), data/characters/humanoid3d.txt and data/controllers/humanoid3d_ctrl.txt of its code. That body has 45 kg;
a torque is its share of the mass here.
"""

from __future__ import annotations

STRENGTH_NM_PER_KG: dict[str, float] = {
    "hip": 200 / 45,
    "knee": 150 / 45,
    "ankle": 90 / 45,
    "foot": 0.3,
    "spine1": 200 / 45,
    "spine2": 200 / 45,
    "spine3": 200 / 45,
    "neck": 50 / 45,
    "head": 50 / 45,
    "collar": 100 / 45,
    "shoulder": 100 / 45,
    "elbow": 60 / 45,
    "wrist": 0.3,
}
"""Largest torque of each hinge of a joint. The source has no toes, and rigid wrists: theirs, about 20 Nm of an adult,
carry the forefoot of a person who stands, and 10 kg in a hand. The collar bone carries the arm, and has its torque."""

FULL_TORQUE_RAD = 0.05
"""Error of the angle at which an actuator gives its whole torque: a pose that it has the strength for is held within
3 degrees. The source's gains, with 0.2 to 0.4 rad, let a bent trunk sink by 20."""

RESPONSE_S = 0.1
"""Ratio of damping to stiffness of an actuator, in which an error falls to 37 %: that of the source."""


def max_torque(joint: str, mass_kg: float) -> float:
    """Return the largest torque, Nm, of a joint such as "left_elbow" of a person of a mass."""
    return STRENGTH_NM_PER_KG[joint.rpartition("_")[2]] * mass_kg
