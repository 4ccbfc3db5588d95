"""Variants of `validate` and `compare` with their steps and tolerances: data of ``campaigns/validation.toml``.

Nothing here knows an engine by name but the reference, to which the others are compared. An engine without a variant in
the file takes part in every comparison, at each of its fidelities with the file's steps for ``others``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

from stiction.comparisons.bench.campaign import CAMPAIGNS, Campaign, load_campaign
from stiction.comparisons.bench.depth import Depth, Extent, down_to
from stiction.comparisons.bench.variants import Variant
from stiction.engines.registry import absolute_name, engine_names, entry_of

REFERENCE, PAPERS_SCHEME = "reference", "paper's scheme"
"""Labels of the variants of the reference in its default method and in that of the paper."""


@cache
def validation_campaign() -> Campaign:
    """Return the campaign of `stiction validate`, with the variants of all engines that it knows."""
    return load_campaign(CAMPAIGNS / "validation.toml")


def participants(engines: Iterable[str] | None = None) -> tuple[Variant, ...]:
    """Return all variants of the reference and of these engines; those of the file first.

    Where None, of all known ones but those that the system runs, which take part where they are named.
    """
    campaign = validation_campaign()
    known_here = [
        name for name in engine_names() if not ((entry := entry_of(name)) and entry.run_by_system)
    ]
    chosen = dict.fromkeys(
        [REFERENCE, *(known_here if engines is None else map(absolute_name, engines))]
    )
    with_variants = {variant.engine for variant in campaign.variants}
    return (
        *(variant for variant in campaign.variants if variant.engine in chosen),
        *(
            variant
            for name in chosen
            if name not in with_variants
            for variant in campaign.variants_of(name)
        ),
    )


def extent(depth: Depth) -> Extent:
    """Return how far `validate` goes at a depth."""
    return validation_campaign().depths[depth]


def variants(
    engines: Iterable[str] | None = None, depth: Depth = Depth.FULL
) -> tuple[Variant, ...]:
    """Return those whose runs are compared."""
    return _refined(engines, depth, "ladder", "runs")


def cost_variants(
    engines: Iterable[str] | None = None, depth: Depth = Depth.FULL
) -> tuple[Variant, ...]:
    """Return those of work-precision diagrams, with the steps for it."""
    return _refined(engines, depth, "cost", "cost")


def threshold_variants(
    engines: Iterable[str] | None = None, depth: Depth = Depth.FULL
) -> tuple[Variant, ...]:
    """Return those whose stick threshold is measured, with the steps for it."""
    return _refined(engines, depth, "threshold", "threshold")


def _refined(
    engines: Iterable[str] | None, depth: Depth, series: str, of_depth: str
) -> tuple[Variant, ...]:
    """Return the participants with one of their series as ladder, as far as a depth goes, if any is left."""
    finest = getattr(extent(depth), of_depth)
    refined = []
    for variant in participants(engines):
        ladder = down_to(getattr(variant, series), variant.parameter, finest)
        if ladder:
            refined.append(replace(variant, ladder=ladder))
    return tuple(refined)


def variant(label: str) -> Variant:
    """Return a variant of the file by its label."""
    return next(variant for variant in validation_campaign().variants if variant.label == label)
