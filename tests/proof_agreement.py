"""Agreement of proven motions with truths in floats."""

from flint import arb

ESTIMATED = 3
"""Ratio up to which the error of a truth may exceed its uncertainty where that is a difference of two
discretizations: an estimate."""


def close(ball, value, doubt):
    """Return whether a float is in a ball, up to its own error."""
    return abs(float(ball.mid()) - value) <= float(ball.rad()) + doubt


def assert_agreement(truth, motion, times, estimated=ESTIMATED):
    """Compare events in order, and the columns of the motion at some times, up to the truth's own error."""
    mechanism = motion.mechanism
    with motion.precision.working():
        assert [(e.kind, e.joint) for e in motion.events] == [(e.kind, e.joint) for e in truth.events]
        for proven, event in zip(motion.events, truth.events):
            assert close(proven.time, event.time, estimated * truth.uncertainty["event time"])
        for t in times:
            for name, ball in mechanism.columns(arb(float(t)), *motion.at(arb(float(t)))).items():
                assert close(ball, truth(t)[name][0], estimated * truth.uncertainty[name]), (name, t)
