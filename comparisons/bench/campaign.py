"""A campaign file: runs of every night, and the part of them that a check makes, as TOML validated like a scene.

`nightly` makes the runs of such a file:

    title = ".."
    scenes = ["slider-bar-case-1", "mine.toml"]     # of the catalogue, or files in the folder of this one
    measure = ["accuracy", "motion", "event", "drift", "counter", "time"]     # all of them if not given
    repeats = 7                                     # timed repeats of a run
    workers = 1                                     # runs at a time; more than one disturb each other's times

    [budget]
    run = 120                                       # seconds that one run may take
    total = 3600                                    # seconds after which no run is begun

    [variants."reference, tight"]                   # an engine with fixed settings over steps or tolerances
    engine = "reference"                            # a name, module:Class or, relative to this file, a program's .toml
    fidelity = "joint"                              # or "contact"
    rtol = [1e-6, 1e-9]                             # or dt = [1e-2, 1e-3]: seconds; from coarse to fine
    settings = { stabilization = "projection" }     # of the engine
    cost = [1e-3, 1e-6, 1e-9]                       # for `validate` and `compare`: see campaigns/validation.toml
    threshold = [1e-9]

    [others.dt]                                     # of engines without a variant above, by what their method has:
    dt = [1e-2, 1e-3]                               # dt or rtol; those of `stiction validate` if not given

    [check]                                         # what `stiction check` runs; all of the above if not given
    scenes = ["slider-bar-case-1"]
    variants = ["reference, tight"]
    every = ["slider-bar-case-1"]                   # scenes of these on which every variant takes its first step, too
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
DEFAULT = CAMPAIGNS / "nightly.toml"
"""The campaign of the suite itself."""


class CampaignError(FileError):
    """A campaign that cannot be used."""


class _Steps(Model):
    """Values of one of `PARAMETERS`, from coarse to fine: of the runs that are compared, of cost, of the threshold."""

    dt: tuple[Positive, ...] | None = None
    rtol: tuple[Positive, ...] | None = None
    iterations: tuple[Positive, ...] | None = None
    cost: tuple[Positive, ...] = ()
    threshold: tuple[Positive, ...] = ()

    @property
    def parameters(self) -> list[str]:
        return [name for name in PARAMETERS if getattr(self, name) is not None]

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
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
        way = "increase" if parameter == "iterations" else "decrease"
        for name in (parameter, "cost", "threshold"):
            steps = getattr(self, name)
            if list(steps) != sorted(set(steps), reverse=way == "decrease"):
                yield name, steps, f"expected numbers that {way}: from coarse to fine"

    def variant(self, label: str, engine: str, **others: Any) -> Variant:
        [parameter] = self.parameters
        number = int if parameter == "iterations" else float
        ladder, cost, threshold = (
            tuple(map(number, getattr(self, name))) for name in (parameter, "cost", "threshold")
        )
        # the name of a file in baselines, for any machine
        portable = label_of(engine) if is_file(engine) else ""
        return Variant(
            label,
            engine,
            parameter,
            ladder,
            cost=cost,
            threshold=threshold,
            stands_for=portable,
            **others,
        )


def _placed(engine: Any, info: ValidationInfo) -> Any:
    """Return an engine; of one that is a file, which is relative to that of the campaign, its absolute path."""
    if not isinstance(engine, str) or not is_file(engine):
        return engine
    return absolute_name(str(Path(info.context or "") / engine))


class _Variant(_Steps):
    engine: Annotated[str, BeforeValidator(_placed)]
    fidelity: Fidelity = Fidelity.JOINT
    settings: dict[str, Any] = {}
    effects: dict[str, dict[str, Any]] = {}

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        if is_file(self.engine):
            if not Path(self.engine).is_file():
                yield (
                    "engine",
                    Path(self.engine).name,
                    ("expected the declaration of a program or an FMU, relative to this file"),
                )
        elif ":" not in self.engine and self.engine not in (known := engine_names()):
            hint = did_you_mean(self.engine, known)
            yield (
                "engine",
                self.engine,
                (
                    f"expected {', '.join(known)}, module:Class, a program's FILE.toml or a "
                    f"FILE.fmu{hint}"
                ),
            )
        yield from super().inconsistencies()


class _Others(Model):
    """Steps and tolerances of engines without a variant, by the parameter of their method."""

    dt: _Steps
    rtol: _Steps


class _Budget(Model):
    run: Positive = 240.0
    total: Positive = 3600.0


class _Check(Model):
    scenes: tuple[str, ...]
    variants: tuple[str, ...]
    every: tuple[str, ...] = ()

    @property
    def scene_names(self) -> list[str]:
        return [Path(name).stem for name in self.scenes]

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        yield from _unknown("every", self.every, self.scenes, "the check's scenes")


def _unknown(
    key: str, given: Sequence[str], known: Sequence[str], of: str
) -> Iterator[tuple[str, str, str]]:
    for i, name in enumerate(given):
        if name not in known:
            yield (
                f"{key}.{i}",
                name,
                f"expected one of {of}: {names(known)}{did_you_mean(name, known)}",
            )


def _loaded(given: Any) -> Scene:
    """Load a scene by its name in the catalogue or the path of its file."""
    if not isinstance(given, str):
        raise InputError("expected text")
    try:
        return load_scene(given)
    except SceneError as error:
        raise InputError(
            "; ".join(
                problem.expected if problem.key == "scene" else str(problem)
                for problem in error.problems
            )
        ) from None


def _as_variants(tables: dict[str, _Variant]) -> tuple[Variant, ...]:
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


if TYPE_CHECKING:
    _Variants = tuple[Variant, ...]
else:  # as the file has them: a table that becomes the tuple
    _Variants = Annotated[dict[_Label, _Variant], Field(min_length=1), AfterValidator(_as_variants)]


class Campaign(Model):
    """A campaign, loaded; see the module. Its scenes are loaded, its variants a tuple of `Variant`."""

    title: str = ""
    scenes: tuple[Annotated[Scene, BeforeValidator(_loaded)], ...]
    variants: _Variants
    others: _Others | None = None
    measure: tuple[Kind, ...] = KINDS
    repeats: Annotated[int, Field(ge=1)] = 7
    workers: Annotated[int, Field(ge=1)] = 1
    budget: _Budget = _Budget()
    check: _Check | None = None
    depths: dict[Depth, Extent] = {}
    """Extents of `stiction validate`; no other campaign has any."""
    _name: str = ""

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        if not self.scenes:
            yield "scenes", [], "expected at least 1"
        scenes = [scene.name for scene in self.scenes]
        for i, name in enumerate(scenes):
            if name in scenes[:i]:
                yield f"scenes.{i}", name, f"expected one scene of the name {name}"
        if self.check is not None:
            labels = [variant.label for variant in self.variants]
            yield from _unknown("check.scenes", self.check.scene_names, scenes, "the campaign")
            yield from _unknown("check.variants", self.check.variants, labels, "the campaign")

    @property
    def name(self) -> str:
        """Name of the file, without its ending."""
        return self._name

    @property
    def every(self) -> tuple[str, ...]:
        """Names of the scenes on which a check runs every variant."""
        return tuple(Path(name).stem for name in self.check.every) if self.check is not None else ()

    @property
    def runs(self) -> list[PlannedRun]:
        """Scene by scene, its truth first: a child works out a truth once for all runs that follow each other."""
        return [
            run
            for scene in self.scenes
            for run in (
                PlannedRun(scene),
                *(
                    PlannedRun(scene, variant, step, scene.name in self.every)
                    for variant in self.variants
                    for step in variant.ladder
                ),
            )
        ]

    @property
    def check_runs(self) -> list[PlannedRun]:
        """Runs of a check: those of its scenes and variants, and each variant's first step on the scenes of `every`."""
        if (check := self.check) is None:
            return self.runs
        return [
            run
            for run in self.runs
            if run.scene.name in check.scene_names
            and (
                run.variant is None
                or run.variant.label in check.variants
                or run.followed
                and run.step == run.variant.ladder[0]
            )
        ]

    def of_engine(self, name: str) -> Campaign:
        """Return the campaign for one engine alone, all of whose runs belong to the check; errors of `load_engine`.

        One of the campaign keeps its variants. One whose class is derived from that of an engine of the campaign takes
        its place and is held to that one's baseline. Any other has `variants_of` its own.
        """
        name = absolute_name(name)
        # unlike one of many in a campaign, one that is requested alone must be there
        engine = load_engine(name)
        own = (
            tuple(variant for variant in self.variants if variant.engine == name)
            or tuple(
                replace(variant, engine=name, stands_for=variant.engine)
                for variant in self.variants
                if _is_derived(engine, variant.engine)
            )
            or self.variants_of(name)
        )
        check = self.check and self.check.model_copy(
            update={"variants": tuple(variant.label for variant in own)}
        )
        return self.model_copy(update={"variants": own, "check": check})

    def variants_of(self, name: str) -> tuple[Variant, ...]:
        """Return variants of an engine that the campaign does not know: each fidelity, with the steps of `others`."""
        if (others := self.others) is None:
            return load_campaign(CAMPAIGNS / "validation.toml").variants_of(name)
        try:
            capabilities = load_engine(name).capabilities
        except EngineMissing:  # the row of its run will say so
            return (others.dt.variant(label_of(name), name),)
        steps, label = others.rtol if capabilities.adaptive else others.dt, label_of(name)
        return tuple(
            steps.variant(
                label if fidelity == Fidelity.JOINT else f"{label}, {fidelity}",
                name,
                fidelity=fidelity,
            )
            for fidelity in capabilities.fidelities
        )


def _is_derived(engine: Any, name: str) -> bool:
    if is_file(name):
        return False  # all programs have one class, and all FMUs
    try:
        return isinstance(engine, type(load_engine(name)))
    except EngineMissing:
        return False


def _scene_in(folder: Path, name: Any) -> Any:
    """Return the name of a scene of the catalogue; of one that is a file, which lies in a folder, its path."""
    if not isinstance(name, str) or name in catalogue():
        return name
    return str(folder / name) if name.endswith(".toml") or (folder / name).is_file() else name


def load_campaign(path: str | Path | None = None, scenes: Sequence[str] = ()) -> Campaign:
    """Read a campaign: that of a file, the suite's own where None.

    `scenes` are names or paths that replace the scenes of the campaign and of its part for checks. Raises
    `CampaignError` with all problems of the file at once, or of these scenes.
    """
    path = DEFAULT if path is None else Path(path)
    try:
        tables = read_toml(path, str(path))
        if scenes:
            tables["scenes"] = list(scenes)
            if isinstance(check := tables.get("check"), dict):
                every = [name for name in check.get("every", ()) if name in scenes]
                tables["check"] = {**check, "scenes": list(scenes), "every": every}
        elif isinstance(given := tables.get("scenes"), list):
            tables["scenes"] = [_scene_in(path.parent, name) for name in given]
        campaign = Campaign.model_validate(tables, context=path.parent)
    except SceneError as error:
        raise CampaignError(str(path), error.problems) from None
    except ValidationError as error:
        problems = list(problems_of(error, Campaign))
        of_scenes = scenes and all(problem.key.startswith("scenes.") for problem in problems)
        raise CampaignError(", ".join(scenes) if of_scenes else str(path), problems) from None
    campaign._name = path.stem
    return campaign
