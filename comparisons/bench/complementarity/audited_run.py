"""The complementarity problems of a run of the reference at every instant that its method has a say in.

The event-driven method chooses a contact mode at the start and at events, and freezes it in between. At one instant of
each step, the audit, it verifies the mode. Hence the instants: the start, both sides of each event, the end of each
accepted step and the audit in it. States within a step are those of its dense output. The stages of a step are none:
they are approximations that the step corrects, and no state of the motion.
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
"""Tolerance of the run: the reference's own."""


def write_problems_of_run(scene: Scene, path: str | Path) -> int:
    """Simulate a scene with the reference and write the problems of the run; returns their number.

    Raises InputError if there are none, as of a scene without friction, or the start is inconsistent.
    """
    load_engine("reference").prepare_run(scene)
    problems = [problem for part in independent_parts(scene) for problem in _of_part(part)]
    if not problems:
        raise InputError(
            f"{scene.name}: found no complementarity problem; expected a scene with friction"
        )
    return write_problems(problems, path)


def _of_part(scene: Scene) -> list[Problem]:
    mechanism = Mechanism(scene)
    if not mechanism.guide_names:
        return []
    # A first run for the ends of its steps, a second one for the states there and at the audits
    # within.
    q, v = consistent_start(mechanism)
    ends = [0.0]
    simulate_event_driven(mechanism, q, v, np.zeros(0), scene.t_end, RTOL, sides=False, ends=ends)
    audits = (np.arange(1, len(ends)) * GOLDEN) % 1.0
    instants = np.unique(np.concatenate([ends, np.array(ends[:-1]) + audits * np.diff(ends)]))
    run = simulate_event_driven(mechanism, q, v, instants, scene.t_end, RTOL)
    return problems_met("run", scene, run, everywhere=True)
