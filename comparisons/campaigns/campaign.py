"""What is run every night, and the part of it that a check runs: a TOML file, validated like a scene.

    title = ".."
    scenes = ["slider-bar-case-1", "mine.toml"]     # of the catalogue, or files beside this one
    measure = ["accuracy", "motion", "event", "drift", "counter", "time"]     # all of them if not given
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
    cost = [1e-3, 1e-6, 1e-9]                       # other ladders of it, for `validate` and `compare`: see campaigns/validation.toml
    threshold = [1e-9]

    [others.dt]                                     # ladders of engines without a variant above, by what their method has: dt or rtol;
    dt = [1e-2, 1e-3]                               # those of `stiction validate` if not given

    [check]                                         # what `stiction check` runs; all of the above if not given
    scenes = ["slider-bar-case-1"]
    variants = ["reference, tight"]
    every = ["slider-bar-case-1"]                   # of these scenes: those on which every variant takes a rung, too
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from stiction.comparisons.campaigns.measurement import KINDS, PlannedRun
from stiction.comparisons.depth import Depth, Extent
from stiction.comparisons.variants import Variant
from stiction.engines.registry import EngineMissing, engine_names, load_engine
from stiction.scenes import FileError, Problem, Scene, SceneError, catalogue, load_scene
from stiction.scenes.errors import expectation, found_in
from stiction.scenes.fields import Model, Positive
from stiction.scenes.loading import read_toml
from stiction.scenes.wording import did_you_mean, names, shortened, shown

CAMPAIGNS = Path(str(resources.files("stiction.comparisons") / "campaigns"))
DEFAULT = CAMPAIGNS / "nightly.toml"
"""The campaign of the suite itself."""


PARAMETERS = ("dt", "rtol", "iterations")
"""What a ladder may vary: a step (s), a relative tolerance, the iterations by which an engine solves a step."""


class CampaignError(FileError):
    """A campaign that cannot be used."""


Rungs = tuple[Positive, ...]


class _Ladders(Model):
    """One parameter of `PARAMETERS`, and ladders of it for several ends."""

    dt: Rungs | None = None
    rtol: Rungs | None = None
    iterations: Rungs | None = None
    cost: Rungs = ()
    threshold: Rungs = ()

    @property
    def parameter(self) -> str:
        return next(name for name in PARAMETERS if getattr(self, name) is not None)

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        given = [name for name in PARAMETERS if getattr(self, name) is not None]
        if len(given) != 1:
            yield ", ".join(PARAMETERS), " and ".join(given) or "none", "expected one of them: steps in seconds, tolerances, or iterations of a step"
            return
        if not (getattr(self, given[0]) or self.cost or self.threshold):
            yield given[0], (), "expected at least 1 number"
        for name in (given[0], "cost", "threshold"):
            ladder = getattr(self, name)
            finer = [-rung if given[0] == "iterations" else rung for rung in ladder]
            if any(fine >= coarse for coarse, fine in zip(finer, finer[1:])):
                yield name, ladder, f"expected numbers that {'increase' if given[0] == 'iterations' else 'decrease'}: from coarse to fine"

    def variant(self, label: str, engine: str, fidelity: str, settings: Mapping[str, Any] = MappingProxyType({})) -> Variant:
        number = int if self.parameter == "iterations" else float
        ladder, cost, threshold = (tuple(map(number, rungs)) for rungs in (getattr(self, self.parameter), self.cost, self.threshold))
        return Variant(label, engine, self.parameter, ladder, fidelity, dict(settings), cost=cost, threshold=threshold)


class _Variant(_Ladders):
    engine: str
    fidelity: Literal["joint", "contact"] = "joint"
    settings: dict[str, Any] = {}
    effects: dict[str, dict[str, Any]] = {}

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        if ":" not in self.engine and self.engine not in (known := engine_names()):
            yield "engine", self.engine, f"expected {', '.join(known)} or module:Class{did_you_mean(self.engine, known)}"
        yield from super().inconsistencies()


class _Others(Model):
    """Ladders of engines that have no variant of their own."""

    dt: _Ladders
    rtol: _Ladders


class _Budget(Model):
    run: Positive = 240.0
    total: Positive = 3600.0


class _Finest(Model):
    """The finest rung by parameter."""

    dt: Positive | None = None
    rtol: Positive | None = None
    iterations: Positive | None = None

    @property
    def given(self) -> dict[str, float]:
        return {name: rung for name in PARAMETERS if (rung := getattr(self, name)) is not None}


class _Extent(Model):
    """`stiction.comparisons.depth.Extent`."""

    limit: Positive
    runs: _Finest = _Finest()
    cost: _Finest = _Finest()
    threshold: _Finest = _Finest()
    bracket: Positive
    repeats: Annotated[int, Field(ge=1)]
    ladder: Positive
    sensitivity: bool
    equal_error: bool
    settings: bool
    trajectories: Literal["drawn", "all"]

    @property
    def extent(self) -> Extent:
        return Extent(self.limit, self.runs.given, self.cost.given, self.threshold.given, self.bracket, self.repeats, self.ladder, self.sensitivity, self.equal_error, self.settings,
                      self.trajectories)


class _Part(Model):
    scenes: tuple[str, ...]
    variants: tuple[str, ...]
    every: tuple[str, ...] = ()

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        for i, name in enumerate(self.every):
            if name not in self.scenes:
                near = did_you_mean(name, self.scenes)
                yield f"every.{i}", name, f"expected one of the check's scenes: {names(self.scenes)}{near}"


class _File(Model):
    title: str = ""
    scenes: Annotated[tuple[str, ...], Field(min_length=1)]
    variants: Annotated[dict[Annotated[str, Field(pattern=r"^[^/|\n]+$")], _Variant], Field(min_length=1)]
    others: _Others | None = None
    measure: tuple[Literal[KINDS], ...] = KINDS
    random: Annotated[int, Field(ge=0)] = 0
    random_mechanisms: Annotated[int, Field(ge=0)] = 0
    repeats: Annotated[int, Field(ge=1)] = 7
    workers: Annotated[int, Field(ge=1)] = 1
    budget: _Budget = _Budget()
    check: _Part | None = None
    depths: dict[Depth, _Extent] = {}

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        for key, known in (("scenes", self.scenes), ("variants", self.variants)):
            for i, name in enumerate(getattr(self.check, key, ())):
                if name not in known:
                    yield f"check.{key}.{i}", name, f"expected one of the campaign: {names(known)}{did_you_mean(name, known)}"


_TABLES = {"variants": _Variant, "others": _Ladders, "budget": _Budget, "check": _Part, "depths": _Extent}


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
    random_mechanisms : int
        The same of mechanisms of one degree of freedom that come to rest (`resting_mechanisms`).
    run_s, total_s : float
        Budgets, seconds.
    checked : tuple of tuple of str
        Names of the scenes and of the variants of the part for checks.
    every : tuple of str
        Names of its scenes on which a check runs every variant; there all fixed steps are held to the path that they took.
    brief : tuple of str
        Labels of variants that run on the scenes of `every` alone, at their first rung.
    others : Mapping[str, Variant]
        By parameter, the ladders of engines without a variant.
    depths : Mapping[Depth, Extent]
        Of the campaign of `stiction validate`; no other has any.
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
    others: Mapping[str, Variant]
    random: int = 0
    random_mechanisms: int = 0
    depths: Mapping[Depth, Extent] = field(default_factory=dict)
    every: tuple[str, ...] = ()
    brief: tuple[str, ...] = ()

    @property
    def runs(self) -> list[PlannedRun]:
        """Scene by scene, its truth first: a child works out a truth once for all runs that follow each other."""
        return [run for scene in self.scenes for run in (
            PlannedRun(scene), *(PlannedRun(scene, variant, step, scene.name in self.every)
                                 for variant in self.variants for step in self._rungs(scene, variant)))]

    def _rungs(self, scene: Scene, variant: Variant) -> tuple[float, ...]:
        if variant.label not in self.brief:
            return variant.ladder
        return variant.ladder[:1] if scene.name in self.every else ()

    @property
    def check(self) -> Campaign:
        """The part that a check runs."""
        scenes, variants = self.checked
        brief = tuple(variant.label for variant in self.variants if variant.label not in variants) if self.every else ()
        return replace(self, scenes=tuple(scene for scene in self.scenes if scene.name in scenes), brief=brief,
                       variants=tuple(variant for variant in self.variants if variant.label in (*variants, *brief)))

    @property
    def checked_whole(self) -> Campaign:
        """The same with a check that runs all of it."""
        return replace(self, checked=(tuple(scene.name for scene in self.scenes), tuple(variant.label for variant in self.variants)))

    def of_engine(self, name: str) -> Campaign:
        """The same for one engine alone.

        One of the campaign keeps its variants. One whose class is derived from that of an engine of the campaign takes its
        place and is held to that one's baseline. Any other has `variants_of` its own.

        Raises
        ------
        UnknownEngine, EngineMissing
            See `stiction.engines.load_engine`.
        """
        engine = load_engine(name)  # unlike one of many in a campaign, one asked for alone must be there
        own = tuple(variant for variant in self.variants if variant.engine == name)
        if not own:
            own = tuple(replace(variant, engine=name, stands_for=variant.engine) for variant in self.variants if _derived(engine, variant.engine))
        own = own or self.variants_of(name)
        return replace(self, variants=own, checked=(self.checked[0], tuple(variant.label for variant in own)))


    def variants_of(self, name: str) -> tuple[Variant, ...]:
        """Of an engine that the campaign does not know: one for each fidelity, with the ladders of `others`."""
        try:
            capabilities = load_engine(name).capabilities
        except EngineMissing:  # the row of its run will say so
            return (replace(self.others["dt"], label=name, engine=name),)
        ladders = self.others["rtol" if capabilities.adaptive else "dt"]
        return tuple(replace(ladders, label=name if fidelity == "joint" else f"{name}, {fidelity}", engine=name, fidelity=fidelity)
                     for fidelity in capabilities.fidelities)


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
        With all problems of the file at once, or of the scenes that replace its own.
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
        raise CampaignError(", ".join(scenes) or origin, problems)
    labels = tuple(found.variants)
    part = found.check or _Part(scenes=found.scenes, variants=labels)
    checked, every = (tuple(scene.name for name, scene in zip(scenes or found.scenes, loaded) if chosen is None or name in chosen)
                      for chosen in (None if scenes else part.scenes, part.every))
    return Campaign(path.stem, tuple(loaded), tuple(replace(ladders.variant(label, ladders.engine, ladders.fidelity, ladders.settings), effects=ladders.effects) for label, ladders in found.variants.items()),
                    found.measure, found.repeats, found.workers, found.budget.run, found.budget.total, (checked, part.variants),
                    _others(found), found.random, found.random_mechanisms, {depth: extent.extent for depth, extent in found.depths.items()}, every)


def _others(found: _File) -> dict[str, Variant]:
    if found.others is None:
        return dict(load_campaign(CAMPAIGNS / "validation.toml").others)
    return {name: ladders.variant("", "", "joint") for name, ladders in (("dt", found.others.dt), ("rtol", found.others.rtol))}


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
        elif detail["type"] == "extra_forbidden":
            known = _TABLES.get(location[0], _File).model_fields if len(location) > 1 else _File.model_fields
            yield Problem(key, found, f"unknown key{did_you_mean(location[-1], known) or f'; expected one of: {names(known)}'}")
        else:
            yield Problem(key, found_in(detail), expectation(detail))
