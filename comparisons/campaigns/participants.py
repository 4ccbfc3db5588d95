"""Who takes part in `validate` and `compare`, over which ladders: data of ``campaigns/validation.toml``, the same for every engine.

Nothing here knows an engine by name but the reference, to which the others are compared. An engine that has no variant in the file, as one
that another package announces or that is given as ``module:Class``, takes part at each of its fidelities with the file's ladders for
``others``, in every comparison.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

from stiction.comparisons.campaigns.campaign import CAMPAIGNS, Campaign, load_campaign
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


def variants(engines: Iterable[str] | None = None, quick: bool = False) -> tuple[Variant, ...]:
    """Those whose runs are compared; quick: over the `quick` rungs of their ladders."""
    found = (variant for variant in participants(engines) if variant.ladder)
    return tuple(replace(variant, ladder=variant.quick) if quick else variant for variant in found)


def cost_variants(engines: Iterable[str] | None = None, quick: bool = False) -> tuple[Variant, ...]:
    """Those of work-precision diagrams, over the ladders for it; quick: the coarser half of them."""
    return tuple(replace(variant, ladder=variant.cost[:(len(variant.cost) + 1) // 2] if quick else variant.cost)
                 for variant in participants(engines) if variant.cost)


def threshold_variants(engines: Iterable[str] | None = None, quick: bool = False) -> tuple[Variant, ...]:
    """Those whose stick threshold is measured, over the ladders for it; quick: the coarsest rung."""
    return tuple(replace(variant, ladder=variant.threshold[:1] if quick else variant.threshold)
                 for variant in participants(engines) if variant.threshold)


def variant(label: str) -> Variant:
    """A variant of the file by its label."""
    return next(variant for variant in validation_campaign().variants if variant.label == label)
