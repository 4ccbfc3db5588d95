"""Independent truths: what every engine, the reference included, is compared with.

Written from the equations of motion of each mechanism in its own minimal coordinates; nothing here knows the
reference implementation, a constraint Jacobian or a complementarity problem.

========================  ==========================================  ==========================================
`slider_bar_truth`        the paper's example                         independent high-precision solution
`stick_threshold`         its threshold on F0                         independent high-precision solution
`oscillator_truth`        mass on a spring with dry friction; belt    closed form, phase by phase
`non_stop_peak`, `_limit` Den Hartog's oscillator, steady state       closed form
`stick_slip_cycle`        mass on a belt, steady cycle                closed form
`incline_truth`           block on an incline                         closed form
`slider_crank_truth`      constant speed, frictionless                closed form
`pendulum_truth`          point mass (IFToMM A01)                     closed form
`four_bar_truth`          row of four-bars (IFToMM A02)               closed form
`trammel_truth`           elliptic trammel, two frictional guides     independent high-precision solution
`moving_guide_truth`      slider on a turning arm                     independent high-precision solution
========================  ==========================================  ==========================================
"""

from stiction.comparisons.truth.closed_form.block_on_incline import incline_truth
from stiction.comparisons.truth.closed_form.four_bars import four_bar_truth
from stiction.comparisons.truth.closed_form.oscillator import oscillator_truth
from stiction.comparisons.truth.closed_form.pendulum import pendulum_truth
from stiction.comparisons.truth.closed_form.slider_crank import slider_crank_truth
from stiction.comparisons.truth.closed_form.steady_oscillator import (StickSlipCycle, non_stop_limit, non_stop_peak,
                                                                      stick_slip_cycle)
from stiction.comparisons.truth.reduced.moving_guide import moving_guide_truth
from stiction.comparisons.truth.reduced.piecewise_smooth import NoMotion, Undecided
from stiction.comparisons.truth.reduced.slider_bar import slider_bar_truth
from stiction.comparisons.truth.reduced.steady_state import StickThreshold, stick_threshold
from stiction.comparisons.truth.reduced.trammel import trammel_truth
from stiction.comparisons.truth.truth import CLOSED_FORM, HIGH_PRECISION, NO_TRUTH, PROVEN, PUBLISHED, NotThisMechanism, Truth, TruthRefused

__all__ = ["CLOSED_FORM", "HIGH_PRECISION", "NO_TRUTH", "NoMotion", "NotThisMechanism", "PROVEN", "PUBLISHED", "StickSlipCycle",
           "StickThreshold", "Truth", "TruthRefused", "Undecided", "four_bar_truth", "incline_truth", "moving_guide_truth", "non_stop_limit", "non_stop_peak",
           "oscillator_truth", "pendulum_truth", "slider_bar_truth", "slider_crank_truth", "stick_slip_cycle",
           "stick_threshold", "trammel_truth"]
