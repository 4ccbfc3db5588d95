"""Campaign files: the runs of a nightly campaign, and the part of them that `stiction check` repeats.

A campaign is a TOML file, validated like a scene. This example contains every key:

    title = ".."
    scenes = ["slider-bar-case-1", "mine.toml"]     # names in the catalogue, or files relative to this file
    measure = ["accuracy", "motion", "event", "drift", "counter", "time"]     # default: all
    repeats = 7                                     # timed repeats of a run
    workers = 1                                     # parallel runs; if there are several, times are disturbed

    [budget]
    run = 120                                       # time limit of one run, s
    total = 3600                                    # time after which no run is started, s

    [variants."reference, tight"]                   # an engine with fixed settings over steps or tolerances
    engine = "reference"                            # a name, module:Class or, relative to this file, a program's .toml
    fidelity = "joint"                              # or "contact"
    rtol = [1e-6, 1e-9]                             # or dt = [1e-2, 1e-3]: seconds; from coarse to fine
    settings = { stabilization = "projection" }     # settings of the engine
    cost = [1e-3, 1e-6, 1e-9]                       # only for `validate` and `compare`: see campaigns/validation.toml
    threshold = [1e-9]

    [others.dt]                                     # engines without a variant above, with a fixed step (others.dt)
    dt = [1e-2, 1e-3]                               # or a tolerance (others.rtol); default: as `stiction validate`

    [check]                                         # the runs of `stiction check`; default: all of the above
    scenes = ["slider-bar-case-1"]
    variants = ["reference, tight"]
    every = ["slider-bar-case-1"]                   # scenes on which all variants run with their first step, too
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, ValidationInfo

from stiction.comparisons.bench.depth import Depth, Extent
from stiction.comparisons.bench.planned_runs import KINDS, Kind, PlannedRun
from stiction.comparisons.bench.variants import PARAMETERS, Variant
from stiction.engines.registry import (
    EngineMissing,
    absolute_name,
    engine_names,
    is_file,
    label_of,
    load_engine,
)
from stiction.scenes import FileError, InputError, Scene, SceneError, catalogue, load_scene
from stiction.scenes.errors import problems_of
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import Model, Positive
from stiction.scenes.loading import read_toml
from stiction.scenes.wording import did_you_mean, names

CAMPAIGNS = Path(str(resources.files("stiction.comparisons") / "campaigns"))
"""Folder of the campaign files of the suite."""
DEFAULT = CAMPAIGNS / "nightly.toml"
"""The nightly campaign of the suite."""


class CampaignError(FileError):
    """The error of a campaign file with invalid contents."""


class _Steps(Model):
    """Refinement series of one parameter, each from coarse to fine.

    Exactly one of the parameters `PARAMETERS` is given. Its values are the runs that are compared;
    `cost` and `threshold` are other values of the same parameter, for work-precision diagrams and
    for the stick threshold.
    """

    dt: tuple[Positive, ...] | None = None
    rtol: tuple[Positive, ...] | None = None
    iterations: tuple[Positive, ...] | None = None
    cost: tuple[Positive, ...] = ()
    threshold: tuple[Positive, ...] = ()

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that the table contains."""
        return [name for name in PARAMETERS if getattr(self, name) is not None]

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield key, value and expectation of each problem: the parameter, and the order of values."""
        if len(self.parameters) != 1:
            yield (
                ", ".join(PARAMETERS),
                " and ".join(self.parameters) or "none",
                "expected one of them: steps in seconds, tolerances, or iterations of a step",
            )
            return
        [parameter] = self.parameters
        if not (getattr(self, parameter) or self.cost or self.threshold):
            yield parameter, (), "expected at least 1 number"
        # More iterations are finer, but so are smaller steps and tolerances.
        is_increasing = parameter == "iterations"
        direction = "increase" if is_increasing else "decrease"
        for name in (parameter, "cost", "threshold"):
            steps = getattr(self, name)
            if list(steps) != sorted(set(steps), reverse=not is_increasing):
                yield name, steps, f"expected numbers that {direction}: from coarse to fine"

    def variant(self, label: str, engine: str, **fields: Any) -> Variant:
        """Return the variant of an engine with these series; `fields` are other fields of it."""
        [parameter] = self.parameters
        number = int if parameter == "iterations" else float

        def series(name: str) -> tuple[float, ...]:
            return tuple(number(value) for value in getattr(self, name))

        # Baselines are compared on any machine: they contain the name of a file, not its path.
        stands_for = label_of(engine) if is_file(engine) else ""
        return Variant(
            label,
            engine,
            parameter,
            series(parameter),
            cost=series("cost"),
            threshold=series("threshold"),
            stands_for=stands_for,
            **fields,
        )


def _absolute_engine(engine: Any, info: ValidationInfo) -> Any:
    """Return the name of an engine; the file of a program or FMU gets its absolute path.

    Such a file is given relative to the folder of the campaign, which is the validation context.
    """
    if not isinstance(engine, str) or not is_file(engine):
        return engine
    return absolute_name(str(Path(info.context or "") / engine))


class _Variant(_Steps):
    """A table of `variants`: an engine with fixed settings and its refinement series."""

    engine: Annotated[str, BeforeValidator(_absolute_engine)]
    fidelity: Fidelity = Fidelity.JOINT
    settings: dict[str, Any] = {}
    effects: dict[str, dict[str, Any]] = {}

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield key, value and expectation of each problem: the engine, and those of `_Steps`."""
        if is_file(self.engine):
            if not Path(self.engine).is_file():
                yield (
                    "engine",
                    Path(self.engine).name,
                    "expected the declaration of a program or an FMU, relative to this file",
                )
        elif ":" not in self.engine:
            suite_engines = engine_names()
            if self.engine not in suite_engines:
                hint = did_you_mean(self.engine, suite_engines)
                yield (
                    "engine",
                    self.engine,
                    f"expected {', '.join(suite_engines)}, module:Class, a program's FILE.toml or "
                    f"a FILE.fmu{hint}",
                )
        yield from super().inconsistencies()


class _Others(Model):
    """Series of the engines without a variant in the campaign, by the parameter of their method."""

    dt: _Steps
    rtol: _Steps


class _Budget(Model):
    """Time limits in seconds, for one run and for the start of the last run."""

    run: Positive = 240.0
    total: Positive = 3600.0


class _Check(Model):
    """The part of a campaign that `stiction check` runs: scenes and labels of variants.

    On the scenes `every`, all variants of the campaign run with their first step, too.
    """

    scenes: tuple[str, ...]
    variants: tuple[str, ...]
    every: tuple[str, ...] = ()

    @property
    def scene_names(self) -> list[str]:
        """Names of the scenes, without folders and endings of their files."""
        return [Path(name).stem for name in self.scenes]

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield each scene of `every` that is not a scene of the check."""
        yield from _unknown_names("every", self.every, self.scenes, "the check's scenes")


def _unknown_names(
    key: str, values: Sequence[str], allowed: Sequence[str], owner: str
) -> Iterator[tuple[str, str, str]]:
    """Yield key, value and expectation of each of the values that is not allowed."""
    for i, name in enumerate(values):
        if name not in allowed:
            hint = did_you_mean(name, allowed)
            yield f"{key}.{i}", name, f"expected one of {owner}: {names(allowed)}{hint}"


def _load_named_scene(name: Any) -> Scene:
    """Load a scene by its name in the catalogue or the path of its file."""
    if not isinstance(name, str):
        raise InputError("expected text")
    try:
        return load_scene(name)
    except SceneError as error:
        # The key "scene" would repeat the key of the campaign, which the message begins with.
        messages = [
            problem.expected if problem.key == "scene" else str(problem)
            for problem in error.problems
        ]
        raise InputError("; ".join(messages)) from None


def _as_variants(tables: dict[str, _Variant]) -> tuple[Variant, ...]:
    """Return the variants of the tables, which have their labels as keys."""
    return tuple(
        table.variant(
            label,
            table.engine,
            fidelity=table.fidelity,
            settings=table.settings,
            effects=table.effects,
        )
        for label, table in tables.items()
    )


_Label = Annotated[str, Field(pattern=r"^[^/|\n]+$")]
"""Label of a variant: part of keys, which contain slashes, and of Markdown tables."""


if TYPE_CHECKING:
    _Variants = tuple[Variant, ...]
else:  # Files contain a table by label, which validation turns into the tuple.
    _Variants = Annotated[dict[_Label, _Variant], Field(min_length=1), AfterValidator(_as_variants)]


class Campaign(Model):
    """A campaign read from a file, with its scenes loaded; the module describes the fields."""

    title: str = ""
    scenes: tuple[Annotated[Scene, BeforeValidator(_load_named_scene)], ...]
    variants: _Variants
    others: _Others | None = None
    measure: tuple[Kind, ...] = KINDS
    repeats: Annotated[int, Field(ge=1)] = 7
    workers: Annotated[int, Field(ge=1)] = 1
    budget: _Budget = _Budget()
    check: _Check | None = None
    depths: dict[Depth, Extent] = {}
    """Extents of the depths of `stiction validate`; empty in all other campaigns."""
    _name: str = ""

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield key, value and expectation of each problem with scenes or with the check."""
        if not self.scenes:
            yield "scenes", [], "expected at least 1"
        scenes = [scene.name for scene in self.scenes]
        for i, name in enumerate(scenes):
            if name in scenes[:i]:
                yield f"scenes.{i}", name, f"expected one scene of the name {name}"
        if self.check is not None:
            labels = [variant.label for variant in self.variants]
            check_scenes = self.check.scene_names
            yield from _unknown_names("check.scenes", check_scenes, scenes, "the campaign")
            yield from _unknown_names("check.variants", self.check.variants, labels, "the campaign")

    @property
    def name(self) -> str:
        """Name of the file, without its ending."""
        return self._name

    @property
    def every(self) -> tuple[str, ...]:
        """Names of the scenes on which a check runs every variant."""
        if self.check is None:
            return ()
        return tuple(Path(name).stem for name in self.check.every)

    @property
    def runs(self) -> list[PlannedRun]:
        """All runs, scene by scene, each scene's truth first.

        In this order a child process computes a truth once for all runs that follow it.
        """
        runs = []
        for scene in self.scenes:
            runs.append(PlannedRun(scene))
            is_followed = scene.name in self.every
            for variant in self.variants:
                runs += [PlannedRun(scene, variant, step, is_followed) for step in variant.ladder]
        return runs

    @property
    def check_runs(self) -> list[PlannedRun]:
        """Runs of a check: its variants on its scenes, and all variants' first step on `every`."""
        if self.check is None:
            return self.runs
        scene_names = self.check.scene_names
        labels = self.check.variants
        return [
            run
            for run in self.runs
            if run.scene.name in scene_names and _belongs_to_check(run, labels)
        ]

    def of_engine(self, name: str) -> Campaign:
        """Return the campaign for one engine alone, all of whose runs belong to the check.

        An engine of the campaign keeps its variants. An engine whose class is derived from the
        class of an engine of the campaign takes over its variants, and is compared with its
        baseline. Any other engine gets the variants of `variants_of`.

        Raises
        ------
        UnknownEngine, InputError, EngineMissing
            As `load_engine`: unlike an engine of a campaign, this one must be installed.
        """
        name = absolute_name(name)
        engine = load_engine(name)
        variants = tuple(variant for variant in self.variants if variant.engine == name)
        if not variants:
            variants = tuple(
                replace(variant, engine=name, stands_for=variant.engine)
                for variant in self.variants
                if _is_derived(engine, variant.engine)
            )
        if not variants:
            variants = self.variants_of(name)
        check = self.check
        if check is not None:
            labels = tuple(variant.label for variant in variants)
            check = check.model_copy(update={"variants": labels})
        return self.model_copy(update={"variants": variants, "check": check})

    def variants_of(self, name: str) -> tuple[Variant, ...]:
        """Return variants of an engine that has none in the campaign.

        There is one for each fidelity of the engine, with the steps of `others`; a campaign without
        `others` uses those of `stiction validate`.
        """
        if self.others is None:
            return load_campaign(CAMPAIGNS / "validation.toml").variants_of(name)
        label = label_of(name)
        try:
            capabilities = load_engine(name).capabilities
        except EngineMissing:
            # Its run is planned nevertheless, so that the row of the run reports the reason.
            return (self.others.dt.variant(label, name),)
        steps = self.others.rtol if capabilities.adaptive else self.others.dt
        variants = []
        for fidelity in capabilities.fidelities:
            variant_label = label if fidelity == Fidelity.JOINT else f"{label}, {fidelity}"
            variants.append(steps.variant(variant_label, name, fidelity=fidelity))
        return tuple(variants)


def _belongs_to_check(run: PlannedRun, labels: Sequence[str]) -> bool:
    """Return whether a run on a scene of the check belongs to it, given its labels of variants."""
    if run.variant is None or run.variant.label in labels:
        return True
    return run.followed and run.step == run.variant.ladder[0]


def _is_derived(engine: Any, name: str) -> bool:
    """Return whether the class of an engine is derived from the class of a named engine."""
    if is_file(name):
        return False  # all programs share one class, and so do all FMUs
    try:
        return isinstance(engine, type(load_engine(name)))
    except EngineMissing:
        return False


def _scene_in(folder: Path, name: Any) -> Any:
    """Return the name of a scene of the catalogue, or the path in a folder of any other scene."""
    if not isinstance(name, str) or name in catalogue():
        return name
    path = folder / name
    return str(path) if name.endswith(".toml") or path.is_file() else name


def load_campaign(path: str | Path | None = None, scenes: Sequence[str] = ()) -> Campaign:
    """Read a campaign file.

    Parameters
    ----------
    path : str or Path, optional
        The file; the campaign of the suite, `DEFAULT`, if None.
    scenes : sequence of str
        Names or paths that replace the scenes of the campaign and of its check; none if empty.

    Raises
    ------
    CampaignError
        With all problems of the file, or of `scenes`, at once.
    """
    path = DEFAULT if path is None else Path(path)
    try:
        tables = read_toml(path, str(path))
        _resolve_scenes(tables, path.parent, scenes)
        campaign = Campaign.model_validate(tables, context=path.parent)
    except SceneError as error:
        raise CampaignError(str(path), error.problems) from None
    except ValidationError as error:
        problems = list(problems_of(error, Campaign))
        concerns_scenes = all(problem.key.startswith("scenes.") for problem in problems)
        source = ", ".join(scenes) if scenes and concerns_scenes else str(path)
        raise CampaignError(source, problems) from None
    campaign._name = path.stem
    return campaign


def _resolve_scenes(tables: dict[str, Any], folder: Path, scenes: Sequence[str]) -> None:
    """Replace the scenes of a campaign as read, in place: by others, or by their paths in a folder."""
    if scenes:
        tables["scenes"] = list(scenes)
        check = tables.get("check")
        if isinstance(check, dict):
            every = [name for name in check.get("every", ()) if name in scenes]
            tables["check"] = {**check, "scenes": list(scenes), "every": every}
    elif isinstance(tables.get("scenes"), list):
        tables["scenes"] = [_scene_in(folder, name) for name in tables["scenes"]]
