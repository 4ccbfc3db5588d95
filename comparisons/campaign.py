"""What is run every night, and the part of it that a check runs: a TOML file, validated like a scene.

    title = ".."
    scenes = ["slider-bar-case-1", "mine.toml"]     # of the catalogue, or files beside this one
    measure = ["accuracy", "event", "drift", "counter", "time"]     # all of them if not given
    repeats = 7                                     # timed repeats of a run
    workers = 1                                     # runs at a time; more than one disturb each other's times

    [budget]
    run = 120                                       # seconds that one run may take
    total = 3600                                    # seconds after which no run is begun

    [variants."reference, tight"]                   # an engine with fixed settings over a ladder of steps or tolerances
    engine = "reference"                            # a name or module:Class
    fidelity = "joint"                              # or "contact"
    rtol = [1e-6, 1e-9]                             # or dt = [1e-2, 1e-3]: seconds; from coarse to fine
    settings = { stabilization = "projection" }     # of the engine

    [check]                                         # what `stiction check` runs; all of the above if not given
    scenes = ["slider-bar-case-1"]
    variants = ["reference, tight"]
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from comparisons.measurement import KINDS, Run
from comparisons.variants import Variant
from engines.registry import EngineMissing, engine_names, load_engine
from scenes import FileError, Problem, Scene, SceneError, catalogue, load_scene
from scenes.errors import expectation
from scenes.fields import Model, Positive
from scenes.loading import read_toml
from scenes.wording import did_you_mean, names, shortened, shown

DEFAULT = Path(str(resources.files("comparisons") / "campaigns" / "nightly.toml"))
"""The campaign of the suite itself."""
DEFAULT_LADDERS = {"rtol": (1e-6, 1e-9), "dt": (1e-2, 1e-3)}
"""Of an engine that no campaign has ladders for, by what its method has."""


class CampaignError(FileError):
    """A campaign that cannot be used."""


class _Ladder(Model):
    engine: str
    fidelity: Literal["joint", "contact"] = "joint"
    dt: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = None
    rtol: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = None
    settings: dict[str, Any] = {}

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        if ":" not in self.engine and self.engine not in (known := engine_names()):
            yield "engine", self.engine, f"expected {', '.join(known)} or module:Class{did_you_mean(self.engine, known)}"
        if (self.dt is None) == (self.rtol is None):
            found = "neither" if self.dt is None else "both"
            yield "dt, rtol", found, "expected one of them: the steps of a fixed-step method, or tolerances"
        for name, ladder in (("dt", self.dt), ("rtol", self.rtol)):
            if ladder is not None and any(fine >= coarse for coarse, fine in zip(ladder, ladder[1:])):
                yield name, ladder, "expected numbers that decrease: from coarse to fine"

    def variant(self, label: str) -> Variant:
        parameter, ladder = ("dt", self.dt) if self.rtol is None else ("rtol", self.rtol)
        return Variant(label, self.engine, parameter, ladder, self.fidelity, self.settings)


class _Budget(Model):
    run: Positive = 240.0
    total: Positive = 3600.0


class _Part(Model):
    scenes: tuple[str, ...]
    variants: tuple[str, ...]


class _File(Model):
    title: str = ""
    scenes: Annotated[tuple[str, ...], Field(min_length=1)]
    variants: Annotated[dict[Annotated[str, Field(pattern=r"^[^/|\n]+$")], _Ladder], Field(min_length=1)]
    measure: tuple[Literal[KINDS], ...] = KINDS
    random: Annotated[int, Field(ge=0)] = 0
    repeats: Annotated[int, Field(ge=1)] = 7
    workers: Annotated[int, Field(ge=1)] = 1
    budget: _Budget = _Budget()
    check: _Part | None = None

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        for key, known in (("scenes", self.scenes), ("variants", self.variants)):
            for i, name in enumerate(getattr(self.check, key, ())):
                if name not in known:
                    yield f"check.{key}.{i}", name, f"expected one of the campaign: {names(known)}{did_you_mean(name, known)}"


_TABLES = {"variants": _Ladder, "budget": _Budget, "check": _Part}


@dataclass(frozen=True)
class Campaign:
    """A campaign, loaded; see the module.

    Attributes
    ----------
    name : str
        Of its file.
    scenes : tuple of Scene
    variants : tuple of Variant
    measure : tuple of str
    repeats, workers : int
    random : int
        Random slider-bars that a night draws afresh and holds to the independent solution (`random_slider_bars`).
    run_s, total_s : float
        Budgets, seconds.
    checked : tuple of tuple of str
        Names of the scenes and of the variants of the part for checks.
    """

    name: str
    scenes: tuple[Scene, ...]
    variants: tuple[Variant, ...]
    measure: tuple[str, ...]
    repeats: int
    workers: int
    run_s: float
    total_s: float
    checked: tuple[tuple[str, ...], tuple[str, ...]]
    random: int = 0

    @property
    def runs(self) -> list[Run]:
        """Scene by scene, its truth first: a child works out a truth once for all runs that follow each other."""
        return [run for scene in self.scenes for run in (
            Run(scene), *(Run(scene, variant, step) for variant in self.variants for step in variant.ladder))]

    @property
    def check(self) -> Campaign:
        """The part that a check runs."""
        scenes, variants = self.checked
        return replace(self, scenes=tuple(scene for scene in self.scenes if scene.name in scenes),
                       variants=tuple(variant for variant in self.variants if variant.label in variants))

    def of_engine(self, name: str) -> Campaign:
        """The same for one engine alone.

        One of the campaign keeps its variants. One whose class is derived from that of an engine of the campaign takes its
        place and is held to that one's baseline. Any other is a variant of its own at joint fidelity,
        with `DEFAULT_LADDERS`.

        Raises
        ------
        UnknownEngine, EngineMissing
            See `engines.load_engine`.
        """
        engine = load_engine(name)
        own = tuple(variant for variant in self.variants if variant.engine == name)
        if not own:
            own = tuple(replace(variant, engine=name, stands_for=variant.engine) for variant in self.variants if _derived(engine, variant.engine))
        if not own:
            parameter = "rtol" if engine.capabilities.adaptive else "dt"
            own = (Variant(name, name, parameter, DEFAULT_LADDERS[parameter], engine.capabilities.fidelities[0]),)
        return replace(self, variants=own, checked=(self.checked[0], tuple(variant.label for variant in own)))


def _derived(engine: Any, name: str) -> bool:
    try:
        return isinstance(engine, type(load_engine(name)))
    except EngineMissing:
        return False


def load_campaign(path: str | Path | None = None, scenes: Sequence[str] = ()) -> Campaign:
    """Read a campaign.

    Parameters
    ----------
    path
        Of its file; the suite's own where None.
    scenes
        Names or paths that replace the scenes of the campaign and of its part for checks.

    Raises
    ------
    CampaignError
        With all problems of the file at once.
    """
    path = DEFAULT if path is None else Path(path)
    origin = str(path)
    try:
        raw = read_toml(path, origin)
    except SceneError as error:
        raise CampaignError(origin, error.problems) from None
    try:
        found = _File.model_validate(raw)
    except ValidationError as error:
        raise CampaignError(origin, [*_problems_of(error), *_scenes(raw.get("scenes"), path.parent)[1]]) from None
    loaded, problems = _scenes(scenes or found.scenes, Path() if scenes else path.parent)
    if problems:
        raise CampaignError(origin, problems)
    labels = tuple(found.variants)
    part = found.check or _Part(scenes=found.scenes, variants=labels)
    checked = tuple(scene.name for name, scene in zip(scenes or found.scenes, loaded) if scenes or name in part.scenes)
    return Campaign(path.stem, tuple(loaded), tuple(ladder.variant(label) for label, ladder in found.variants.items()),
                    found.measure, found.repeats, found.workers, found.budget.run, found.budget.total, (checked, part.variants), found.random)


def _scenes(given: Any, folder: Path) -> tuple[list[Scene], list[Problem]]:
    """The scenes, and what is wrong with them; files are looked for beside the campaign."""
    loaded, problems = [], []
    for i, name in enumerate(given if isinstance(given, (list, tuple)) else ()):
        if not isinstance(name, str):
            continue  # told as a problem of the file
        try:
            scene = load_scene(name if name in catalogue() else folder / name)
        except SceneError as error:
            problems += [Problem(f"scenes.{i}", shown(name), problem.expected if problem.key == "scene" else str(problem))
                         for problem in error.problems]
            continue
        if scene.name in (known.name for known in loaded):
            problems.append(Problem(f"scenes.{i}", shown(name), f"expected one scene of the name {scene.name}"))
        loaded.append(scene)
    return loaded, problems


def _problems_of(error: ValidationError) -> Iterator[Problem]:
    for detail in error.errors(include_url=False):
        location, found = detail["loc"], shown(detail["input"])
        key = shortened(".".join(str(part) for part in location if part != "[key]"))
        if detail["type"] == "inconsistent":
            for field, wrong, expected in detail["ctx"]["found"]:
                yield Problem(f"{key}.{field}".lstrip("."), shown(wrong), expected)
        elif detail["type"] == "missing":
            yield Problem(key, "nothing", "this key is required")
        elif detail["type"] == "extra_forbidden":
            known = _TABLES.get(location[0], _File).model_fields if len(location) > 1 else _File.model_fields
            yield Problem(key, found, f"unknown key{did_you_mean(location[-1], known) or f'; expected one of: {names(known)}'}")
        else:
            yield Problem(key, found, expectation(detail))
