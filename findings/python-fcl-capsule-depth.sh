#!/bin/sh
# Two limbs, capsules of 10 cm radius, lie along one line and overlap; another one stands upright in a thin board. FCL
# answers how deep they are in each other: `collide` for contacts, `distance` as a signed distance.
# Guessed: both have one depth, the shortest way out: 20 cm for the capsules, 31 cm for the board.
# Measured on 2026-11-29 with python-fcl 0.7.0.11: `distance` has. `collide` has 55 cm and 81 cm, in silence, the way
# out along another direction, so a solver pushes the limbs apart the long way. For capsules side by side, 5 cm apart,
# both have 15 cm.
# Readers guessed: wrong, wrong, wrong.
. "$(dirname "$0")/common.sh"
install python-fcl==0.7.0.11 numpy==2.4.6
python - <<'PYTHON'
from importlib.metadata import version

import fcl
import numpy as np

CAPSULE, BOARD = fcl.Capsule(0.1, 0.4), fcl.Box(1, 1, 0.02)


def depths(place, other):
    """Depth of a capsule at `place` in another shape at the origin, cm, by both functions."""
    pair = fcl.CollisionObject(CAPSULE, fcl.Transform(np.array(place))), fcl.CollisionObject(other, fcl.Transform())
    contacts = fcl.CollisionResult()
    fcl.collide(*pair, fcl.CollisionRequest(num_max_contacts=10, enable_contact=True), contacts)
    signed = fcl.distance(*pair, fcl.DistanceRequest(enable_signed_distance=True), fcl.DistanceResult())
    return round(100 * max(contact.penetration_depth for contact in contacts.contacts)), round(-100 * signed)


found = {
    "along one line": depths([0, 0, 0.05], CAPSULE),
    "in the board": depths([0, 0, 0.0], BOARD),
    "side by side": depths([0.05, 0, 0.0], CAPSULE),
}
print(f"python-fcl {version('python-fcl')}: depth in cm by collide and by distance: {found}")
if found != {"along one line": (55, 20), "in the board": (81, 31), "side by side": (15, 15)}:
    raise SystemExit("the behaviour has changed")
PYTHON
