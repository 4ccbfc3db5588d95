"""Independent solutions (truths), with which all engines and the reference implementation are compared.

They are derived from the equations of motion of each mechanism in its own minimal coordinates, and use neither the
reference implementation nor a constraint Jacobian nor a complementarity problem. ``docs/theory/truths.md`` lists them.

Each ``.._truth(scene, t_end)`` returns the `Truth` of one kind of mechanism. It raises `NotThisMechanism` for a scene
of another structure, `NoMotion` if the equations have no motion or several, and `Undecided` if two integrations find
different events.
"""

from stiction.truths.clearance.slider_crank_truth import clearance_slider_crank_truth
from stiction.truths.closed_form.block_on_incline import incline_truth
from stiction.truths.closed_form.four_bars import four_bar_truth
from stiction.truths.closed_form.oscillator import oscillator_truth
from stiction.truths.closed_form.pendulum import pendulum_truth
from stiction.truths.closed_form.slider_crank import slider_crank_truth
from stiction.truths.reduced.moving_guide import moving_guide_truth
from stiction.truths.reduced.piecewise_smooth import NoMotion, Undecided
from stiction.truths.reduced.slider_bar import slider_bar_truth
from stiction.truths.reduced.steady_state import StickThreshold, stick_threshold
from stiction.truths.reduced.trammel import trammel_truth
from stiction.truths.truth import (
    TIER_LABELS,
    NotThisMechanism,
    Tier,
    Truth,
    TruthRefused,
)

__all__ = [
    "NoMotion",
    "NotThisMechanism",
    "StickThreshold",
    "TIER_LABELS",
    "Tier",
    "Truth",
    "TruthRefused",
    "Undecided",
    "clearance_slider_crank_truth",
    "four_bar_truth",
    "incline_truth",
    "moving_guide_truth",
    "oscillator_truth",
    "pendulum_truth",
    "slider_bar_truth",
    "slider_crank_truth",
    "stick_threshold",
    "trammel_truth",
]
