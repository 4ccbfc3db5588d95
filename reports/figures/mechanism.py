"""A drawing of each scene, the corners of its slider numbered as in the paper."""

from __future__ import annotations

from collections.abc import Iterator

from stiction.comparisons.results import Results
from stiction.comparisons.methods import case_of
from stiction.reports.figures.style import Drawing, width
from stiction.scenes import catalogue, load_scene
from stiction.scenes.pictures.mechanism import drawing, parameters_in_words

TEXT = 1.2
"""Inches of a drawing's height that labels and legend take, at every width."""


def mechanism_figures(validation: Results) -> Iterator[Drawing]:
    """The mechanism of every scene of the catalogue that was run, at t = 0."""
    for name in dict.fromkeys(record.scene for record in validation.records):
        if name in catalogue():
            scene = load_scene(name)
            picture = drawing(scene, heading=False)
            own, height = picture.get_size_inches()
            picture.set_size_inches(width(), TEXT + (height - TEXT) * width() / own)
            yield Drawing(f"mechanism-{name}", "mechanism", f"The mechanism of {case_of(name)} at t = 0. Corners of the slider are numbered as the paper numbers the forces on them."
                          + (f" In SI units: {parameters_in_words(scene)}." if scene.parameters else ""), picture)
