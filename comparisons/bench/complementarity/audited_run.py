"""The complementarity problems of a run of the reference.

The event-driven method chooses a contact mode at the start and at events, and keeps it between
them. In each step it verifies the mode at one instant, the audit. Accordingly, the problems are
those at the start, on both sides of each event, at the end of each accepted step, and at the
audits, with the states of the dense output. The stages of a step are not used, because they are not
states of the motion: the step corrects their errors.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stiction.comparisons.bench.complementarity.problems import (
    Problem,
    problems_met,
    write_problems,
)
from stiction.engines import load_engine
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.integration.step_audit import GOLDEN
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.reference_impl.multibody.subsystems import independent_parts
from stiction.scenes import InputError, Scene

RTOL = 1e-9
"""Relative tolerance of the run, the default of the reference."""


def write_problems_of_run(scene: Scene, path: str | Path) -> int:
    """Simulate a scene with the reference, write the problems of the run, and return their number.

    Raises InputError if there are none, as in a scene without friction, or if the start is
    inconsistent.
    """
    load_engine("reference").prepare_run(scene)
    problems: list[Problem] = []
    for part in independent_parts(scene):
        problems += _problems_of_part(part)
    if not problems:
        raise InputError(
            f"{scene.name}: found no complementarity problem; expected a scene with friction"
        )
    return write_problems(problems, path)


def _problems_of_part(scene: Scene) -> list[Problem]:
    """Return the problems of the run of an independent part of a scene; none without guides."""
    mechanism = Mechanism(scene)
    if not mechanism.guide_names:
        return []
    # A first run yields the ends of its steps. A second run has its output there and at the audits,
    # which are placed by the golden ratio as in `step_audit`.
    q, v = consistent_start(mechanism)
    ends = [0.0]
    simulate_event_driven(mechanism, q, v, np.zeros(0), scene.t_end, RTOL, sides=False, ends=ends)
    audits = (np.arange(1, len(ends)) * GOLDEN) % 1.0
    instants = np.unique(np.concatenate([ends, np.array(ends[:-1]) + audits * np.diff(ends)]))
    run = simulate_event_driven(mechanism, q, v, instants, scene.t_end, RTOL)
    return problems_met("run", scene, run, everywhere=True)
