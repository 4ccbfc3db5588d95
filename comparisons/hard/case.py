"""Hard cases: scenes, what must be true of their motion, and how that is measured."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from stiction.comparisons.depth import Depth
from stiction.scenes import Scene, Trajectory, load_scene

MOTION, NO_MOTION, REFUSAL, MOTION_OR_WORD = "a motion", "no motion", "a refusal", "a motion or a word"
"""Expectations: one motion; a stop where existence or uniqueness ends; a refusal of the input; the one motion, or the
admission that this method cannot have it."""

NONE, SEVERAL = "no solution", "several solutions"


@dataclass(frozen=True)
class Limits:
    """Errors, relative to the size of what is measured, up to which a run is right, and up to which it is degraded."""

    right: float
    degraded: float


LIMITS = {"rtol": Limits(1e-6, 1e-3), "dt": Limits(1e-2, 1e-1)}
"""Limits by the parameter of a variant. An adaptive method runs at rtol 1e-10: four digits for the growth of local
errors, six that are right. A fixed step is a thousandth of the case's time scale: ten steps' worth of a first-order
error are right. Three digits, or one, less is degraded; beyond that not a digit is left."""

CONDITIONS = Limits(1e-9, 1e-9)
"""Limits of the complementarity conditions of an accepted state, relative: they are solved, not integrated."""

Check = Callable[[Sequence[Scene], Sequence[Trajectory]], dict[str, float]]


@dataclass(frozen=True)
class HardCase:
    """One row of the table of hard cases.

    Attributes
    ----------
    name : str
        Unique.
    topic : str
    scene : str
        Name in the catalogue of scenes; its `source` has the derivation. Empty where there is a `text`.
    must : str
        What must be true, in one line.
    dt : float
        Step of fixed-step methods: a thousandth of the time scale of the case, s.
    check : callable, optional
        ``check(scenes, trajectories)``: by name of a measure its error, relative to the size of what is measured. For a
        case that expects no motion, what would show in a run that goes on.
    expected : str
        `MOTION`, `NO_MOTION`, `REFUSAL` or `MOTION_OR_WORD`.
    stop : callable, optional
        ``stop(scene)``: for `NO_MOTION`, the time (s) at which the motion ends, and `NONE` or `SEVERAL`.
    overrides : Mapping
        Changes of the scene.
    variations : tuple of callable
        Scenes made of the first whose runs must agree with its run; `check` gets all of them.
    limits : Mapping
        By parameter, `Limits` instead of `LIMITS`.
    most_steps : int
        A fixed-step run of more steps than these is not made.
    reference : Mapping
        Settings of the reference instead of its variant's own.
    depth : Depth
        First depth at which it is examined. Those for which all variants together take more than seven seconds are left
        to `Depth.FULL`.
    static : bool
        The case is about mus > mu: nothing for a method with one coefficient, which else gets mus = mu.
    text : callable, optional
        Text of a scene file instead of `scene`, for what could not stand in the catalogue.
    words : str
        Words that a refusal must contain.
    """

    name: str
    topic: str
    scene: str = ""
    must: str = ""
    dt: float = 1e-3
    check: Check | None = None
    expected: str = MOTION
    stop: Callable[[Scene], tuple[float, str]] | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)
    variations: tuple[Callable[[Scene], Scene], ...] = ()
    limits: Mapping[str, Limits] = field(default_factory=lambda: LIMITS)
    most_steps: int = 20_000
    reference: Mapping[str, Any] = field(default_factory=dict)
    depth: Depth = Depth.DEFAULT
    static: bool = False
    text: Callable[[], str] | None = None
    words: str = ""

    @cached_property
    def stops_at(self) -> tuple[float, str]:
        """Value of `stop` for the case's scene: every variant is judged by it."""
        return self.stop(self.scenes()[0])

    def scenes(self, static_coefficient: bool = True) -> tuple[Scene, ...]:
        """The scene of the case and its variations; without a static coefficient with mus = mu.

        Raises
        ------
        SceneError
            If it cannot be loaded, as some cases expect.
        """
        if self.text:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "scene.toml"
                path.write_text(self.text())
                return (load_scene(path),)
        first = load_scene(self.scene, self.overrides)
        if not static_coefficient and not self.static and "mus" in first.parameters:
            first = load_scene(self.scene, {**self.overrides, "mus": "mu"})
        return first, *(variation(first) for variation in self.variations)
