"""Coefficients and bounds of friction that depend on the speed of slip (Stribeck's curve), compiled.

At a given state they are numbers,

    mu(v) = mu + (mus - mu) exp(-(|v| / v_s)^p),    bound(v) likewise,

so that the HLCP stays linear and contact modes stay as they are: `mu` and `bound` of a joint in
`Arrays.friction` are those of the state that `dynamics.row_form` was last called for. All other kernels
read these. Values at v = 0 are the static ones, to the last bit: a joint that breaks away has no jump
of friction, and no choice of mode depends on rounding.

Within a mode the law is a smooth function of the speed in the direction of slip, d v. A step that is made
to end at a stop goes a little beyond it, where |v| would have a kink: there the law is continued smoothly
(`continue_beyond_stop`), as for the shape 1 by the same exponential, so that dense output and secant
method have a smooth function on both sides of the event.
"""

from __future__ import annotations

from math import expm1

from stiction.reference_impl.compiled.bundle import Integers
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.multibody.mechanism import Arrays, Workspace

GAUSSIAN = 2.0
"""Shape for which the law is an even function of the speed, and so its own smooth continuation."""
MOST_BEYOND = 1.0
"""Largest -(d v / v_s)^p of the continued law: farther beyond a stop it is constant, and cannot overflow. A step is
never made to end there."""


@kernel
def set_coefficients(m: Arrays, w: Workspace) -> None:
    """Set `mu` and `bound` of the joints whose friction depends on the slip speeds in the workspace."""
    for f in range(len(m.friction)):
        if m.friction[f].stribeck > 0.0:
            x = abs(w.slip_speed[f]) / m.friction[f].stribeck
            _set_law(m, f, x ** m.friction[f].shape)


@kernel
def continue_beyond_stop(m: Arrays, w: Workspace, slip: Integers) -> None:
    """Set `mu` and `bound` of joints that move against the direction of their mode, `slip`, by the continued law."""
    for f in range(len(m.friction)):
        guide = m.friction[f]
        if guide.stribeck > 0.0 and guide.shape != GAUSSIAN and slip[f] * w.slip_speed[f] < 0.0:
            x = abs(w.slip_speed[f]) / guide.stribeck
            _set_law(m, f, -min(x**guide.shape, MOST_BEYOND))


@kernel
def _set_law(m, f, power):
    """Set the law of joint f in slip for an exponent -power, power = (|v| / v_s)^p."""
    lost = -expm1(-power)  # part of the static excess that is lost; exactly 0 at rest
    guide = m.friction[f]
    m.friction[f].own_bound = guide.own_static - (guide.own_static - guide.kinetic_bound) * lost
    if guide.pin_mus > 0.0:
        m.friction[f].pin_mu = guide.pin_mus - (guide.pin_mus - guide.kinetic_mu) * lost
        set_bounds(m, f, guide.load)
    else:
        m.friction[f].bound = m.friction[f].own_bound
        m.friction[f].mu = guide.mus - (guide.mus - guide.kinetic_mu) * lost


@kernel
def set_bounds(m, f, load):
    """Set the bounds of a pin for the size of the force in it, `load` (newton)."""
    pin = m.friction[f]
    m.friction[f].load = load
    m.friction[f].bound = pin.own_bound + pin.pin_mu * load
    m.friction[f].static_bound = pin.own_static + pin.pin_mus * load
