"""Solvers with a fault, as other people would plug them in: `stiction check --engine damaged_solvers:Slippery`."""

from __future__ import annotations

import math
import os
import time
from dataclasses import replace

import numpy as np

from stiction.engines import EngineFailure
from stiction.engines.reference.engine import ReferenceEngine


class Undamaged(ReferenceEngine):
    """No fault."""

    name = "undamaged"


class Slippery(ReferenceEngine):
    """No more friction at rest than in slip: a motion, with all that belongs to it, of another scene, within the cone of this one."""

    name = "slippery"

    def run(self, scene, **arguments):
        joints = {
            name: joint.model_copy(update={"mus": joint.mu})
            if getattr(joint, "mu", None)
            else joint
            for name, joint in scene.joints.items()
        }
        return super().run(scene.model_copy(update={"joints": joints}), **arguments)


class WrongSign(ReferenceEngine):
    """The moment of the surface friction acts the wrong way round, its lever is half the width: corner forces that the gate refuses."""

    name = "wrong-sign"

    def run(self, scene, **arguments):
        joints = {
            name: joint.model_copy(update={"width": -joint.width})
            if getattr(joint, "width", None)
            else joint
            for name, joint in scene.joints.items()
        }
        return super().run(scene.model_copy(update={"joints": joints}), **arguments)


class LooseEvents(ReferenceEngine):
    """Events are known to a microsecond only; coarser ones have states of other instants, which the gate refuses."""

    name = "loose-events"

    def run(self, scene, **arguments):
        found = super().run(scene, **arguments)
        return replace(
            found,
            events=tuple(
                replace(event, time=math.ceil(event.time / 1e-6) * 1e-6) for event in found.events
            ),
        )


class HalfAsSlowAgain(ReferenceEngine):
    """The first half of the time is done twice.

    `stiction check --engine damaged_solvers:HalfAsSlowAgain --control .` finds it; no test does, for it would hang on the machine.
    """

    name = "half-as-slow-again"

    def run(self, scene, *, t_end, **arguments):
        super().run(scene, t_end=t_end / 2, **arguments)
        return super().run(scene, t_end=t_end, **arguments)


class Sleeping(ReferenceEngine):
    """Each run takes a moment longer."""

    name = "sleeping"

    def run(self, scene, **arguments):
        time.sleep(0.03)
        return super().run(scene, **arguments)


class Buggy(ReferenceEngine):
    name = "buggy"

    def run(self, scene, **arguments):
        return np.zeros(2) + np.zeros(3)


class Crashing(ReferenceEngine):
    name = "crashing"

    def run(self, scene, **arguments):
        os._exit(7)


class Hanging(ReferenceEngine):
    name = "hanging"

    def run(self, scene, **arguments):
        time.sleep(600)


class Failing(ReferenceEngine):
    name = "failing"

    def run(self, scene, **arguments):
        raise EngineFailure("Newton did not converge")
