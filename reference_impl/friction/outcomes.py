"""Outcomes of a solver of the contact problem and of an integration."""

from __future__ import annotations

(
    SOLVED,
    RAY,
    PIVOT_LIMIT,
    NONE,
    SEVERAL,
    SINGULAR,
    SIGN_CYCLE,
    MODE_LIMIT,
    CHATTER,
    STEP_TOO_SMALL,
    NOT_FINITE,
    STEP_LIMIT,
    CRAWL,
    ROOM,
    JAM,
    AUDIT,
    REPEAT,
    UNBOUNDED,
    SELF_LOCKING,
    ILL_CONDITIONED,
    PIN_LOADS,
    PIN_FEEDBACK,
) = range(22)
"""SOLVED: a solution, and for an integration the end of its time. ROOM: an integration's log is full. REPEAT: a step
was rejected, and is to be made anew. SELF_LOCKING and ILL_CONDITIONED are no outcomes of a kernel: they say why it
found none (`result.breakdown_of`), and so does PIN_FEEDBACK; UNBOUNDED is one of an event only."""
DONE = SOLVED

BREAKDOWNS = {
    RAY: (
        "ray",
        "Lemke's method ended on a ray, and the contact modes were not tried: there are too many, or the "
        "solver is 'lemke' alone",
    ),
    PIVOT_LIMIT: (
        "pivot limit",
        "Lemke's method reached its pivot limit, and the contact modes were not tried: there are too many, "
        "or the solver is 'lemke' alone",
    ),
    NONE: (
        "no solution",
        "no solution of the HLCP was found, neither by Lemke's method nor in any contact mode; if constraints "
        "are redundant, only one distribution of their forces was tried",
    ),
    SEVERAL: ("several solutions", "the HLCP has several solutions, whose accelerations differ"),
    JAM: (
        "several solutions",
        "the guide has mus * width > length, and may either start to slip or jam under this load",
    ),
    AUDIT: ("audit", "Coulomb's law is violated within a step: an event was missed"),
    SINGULAR: (
        "singular",
        "the linear system of the contact problem is singular, or its constraints contradict each other",
    ),
    SIGN_CYCLE: ("sign cycle", "trial and error on the signs of the normal forces cycles"),
    MODE_LIMIT: ("mode limit", "there are too many contact modes to try them all"),
    CHATTER: ("chatter", "contact modes follow each other without time passing"),
    STEP_TOO_SMALL: (
        "step too small",
        "the step fell below what the time can resolve: the forces are not smooth here",
    ),
    NOT_FINITE: (
        "not finite",
        "no finite forces or state: constraints that contradict each other, as in a singular position left or "
        "met on "
        "another branch of motion, a distance that is driven to zero, or an unstable step",
    ),
    UNBOUNDED: (
        "jam",
        "the mechanism jams: the normal force of the guide grows without bound, and from then "
        "on no effort of the drives overcomes its friction",
    ),
    SELF_LOCKING: (
        "no solution",
        "the mechanism is self-locking: for the motion that the drives prescribe, "
        "no efforts and forces satisfy Coulomb's law",
    ),
    ILL_CONDITIONED: (
        "not finite",
        "no finite forces or state: masses, or inertias over the square of the largest "
        "lever, differ by more than 1e9, and rounding is as large as the forces",
    ),
    PIN_LOADS: (
        "no solution",
        "no forces in the pins were found that agree with the friction they cause",
    ),
    PIN_FEEDBACK: (
        "several solutions",
        "the friction of pins changes the forces in them by as much as these cause it (friction gain of 1 or more), so "
        "that the motion need not be the only one",
    ),
    STEP_LIMIT: ("step limit", "step limit reached"),
    CRAWL: (
        "crawl",
        "the steps hardly move time: the forces are not smooth here, as near a singular position",
    ),
}
"""Kind of a `stiction.scenes.Breakdown` and its words."""
