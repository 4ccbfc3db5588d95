"""Variants that take part in `stiction validate` and `stiction compare`, with their steps and tolerances.

They are read from ``campaigns/validation.toml``. An engine without a variant in this file takes
part in every comparison, too: in each of its fidelities, with the steps of the section ``others``.
The only engine with a special role is the reference, which always takes part.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

from stiction.comparisons.bench.campaign import CAMPAIGNS, Campaign, load_campaign
from stiction.comparisons.bench.depth import Depth, Extent, limit_refinement
from stiction.comparisons.bench.variants import Variant
from stiction.engines.registry import absolute_name, engine_names, entry_of

REFERENCE = "reference"
"""Name of the engine that is the reference implementation, and label of the variant with its
default method."""
PAPERS_SCHEME = "paper's scheme"
"""Label of the variant of the reference with the method of the paper."""


@cache
def validation_campaign() -> Campaign:
    """Return the campaign of `stiction validate`."""
    return load_campaign(CAMPAIGNS / "validation.toml")


def participants(engines: Iterable[str] | None = None) -> tuple[Variant, ...]:
    """Return all variants of the reference and of other engines, those of the campaign file first.

    Parameters
    ----------
    engines : iterable of str, optional
        Names of engines. If None, all known engines except those that the operating system
        provides, which must be named to take part.
    """
    campaign = validation_campaign()
    if engines is None:
        names = [name for name in engine_names() if not _is_run_by_system(name)]
    else:
        names = [absolute_name(name) for name in engines]
    selected = dict.fromkeys([REFERENCE, *names])  # each name once, in order
    chosen = [variant for variant in campaign.variants if variant.engine in selected]
    engines_of_file = {variant.engine for variant in campaign.variants}
    for name in selected:
        if name not in engines_of_file:
            chosen += campaign.variants_of(name)
    return tuple(chosen)


def _is_run_by_system(name: str) -> bool:
    """Return whether the operating system provides the program of an engine."""
    entry = entry_of(name)
    return entry is not None and entry.run_by_system


def extent(depth: Depth) -> Extent:
    """Return the limits of the runs that `stiction validate` makes at a depth."""
    return validation_campaign().depths[depth]


def variants(
    engines: Iterable[str] | None = None, depth: Depth = Depth.FULL
) -> tuple[Variant, ...]:
    """Return the participants with the steps at which runs are compared."""
    return _refined(engines, depth, "ladder", "runs")


def cost_variants(
    engines: Iterable[str] | None = None, depth: Depth = Depth.FULL
) -> tuple[Variant, ...]:
    """Return the participants with the steps of work-precision diagrams."""
    return _refined(engines, depth, "cost", "cost")


def threshold_variants(
    engines: Iterable[str] | None = None, depth: Depth = Depth.FULL
) -> tuple[Variant, ...]:
    """Return the participants with the steps at which the stick threshold is measured."""
    return _refined(engines, depth, "threshold", "threshold")


def _refined(
    engines: Iterable[str] | None, depth: Depth, series_name: str, limit_name: str
) -> tuple[Variant, ...]:
    """Return the participants whose ladder is one of their series, cut off at the limit of a depth.

    Parameters
    ----------
    engines : iterable of str, optional
        See `participants`.
    depth : Depth
    series_name : str
        Field of `Variant` with the series; participants that have no value in it are left out.
    limit_name : str
        Field of `Extent` with the finest value of this series.
    """
    finest = getattr(extent(depth), limit_name)
    refined = []
    for participant in participants(engines):
        ladder = limit_refinement(getattr(participant, series_name), participant.parameter, finest)
        if ladder:
            refined.append(replace(participant, ladder=ladder))
    return tuple(refined)


def variant(label: str) -> Variant:
    """Return the variant of the campaign of `stiction validate` with a label."""
    by_label = {variant.label: variant for variant in validation_campaign().variants}
    return by_label[label]
