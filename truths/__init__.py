"""Independent truths: what every engine, the reference included, is compared with.

Written from the equations of motion of each mechanism in its own minimal coordinates; nothing here knows the
reference implementation, a constraint Jacobian or a complementarity problem. ``docs/theory/truths.md`` lists them.

The truth of a scene is ``x_truth(scene, t_end)``. It raises `NotThisMechanism` for a scene of another structure and
`NoMotion` where the equations have no motion or several. Where two integrations find different events it raises
`Undecided`.
"""

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
