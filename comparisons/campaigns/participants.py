"""Who takes part in `validate` and `compare`, over which ladders: data of ``campaigns/validation.toml``, the same for every engine.

Nothing here knows an engine by name but the reference, to which the others are compared. An engine that has no variant in the file, as one
that another package announces or that is given as ``module:Class``, takes part at each of its fidelities with the file's ladders for
``others``, in every comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache

from stiction.comparisons.campaigns.campaign import CAMPAIGNS, Campaign, load_campaign
from stiction.comparisons.depth import Depth, Extent, down_to
from stiction.comparisons.variants import Variant
from stiction.engines.registry import engine_names

REFERENCE = "reference"


@cache
def validation_campaign() -> Campaign:
    """The campaign of `stiction validate`, with the variants of all engines that it knows."""
    return load_campaign(CAMPAIGNS / "validation.toml")


def participants(engines: Iterable[str] | None = None) -> tuple[Variant, ...]:
    """All variants of the reference and of the engines named (of all known ones where None), those of the file first."""
    campaign = validation_campaign()
    chosen = dict.fromkeys([REFERENCE, *(engine_names() if engines is None else engines)])
    known = {variant.engine for variant in campaign.variants}
    return (*(variant for variant in campaign.variants if variant.engine in chosen),
            *(variant for name in chosen if name not in known for variant in campaign.variants_of(name)))


def extent(depth: Depth) -> Extent:
    """What a depth of `stiction validate` runs."""
    return validation_campaign().depths[depth]


def variants(engines: Iterable[str] | None = None, depth: Depth = Depth.FULL) -> tuple[Variant, ...]:
    """Those whose runs are compared."""
    return _with_ladders(engines, lambda variant: variant.ladder, extent(depth).runs)


def cost_variants(engines: Iterable[str] | None = None, depth: Depth = Depth.FULL) -> tuple[Variant, ...]:
    """Those of work-precision diagrams, over the ladders for it."""
    return _with_ladders(engines, lambda variant: variant.cost, extent(depth).cost)


def threshold_variants(engines: Iterable[str] | None = None, depth: Depth = Depth.FULL) -> tuple[Variant, ...]:
    """Those whose stick threshold is measured, over the ladders for it."""
    return _with_ladders(engines, lambda variant: variant.threshold, extent(depth).threshold)


def _with_ladders(engines: Iterable[str] | None, ladder_of: Callable[[Variant], tuple[float, ...]], finest: Mapping[str, float]) -> tuple[Variant, ...]:
    """The participants over one of their ladders, as far as a depth goes; those without a rung of it are left out."""
    found = ((variant, down_to(ladder_of(variant), variant.parameter, finest)) for variant in participants(engines))
    return tuple(replace(variant, ladder=ladder) for variant, ladder in found if ladder)


def variant(label: str) -> Variant:
    """A variant of the file by its label."""
    return next(variant for variant in validation_campaign().variants if variant.label == label)
