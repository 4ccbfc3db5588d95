"""Every kind of figure draws where the data are, in looks that can be told apart, inside of its edges, and twice the same."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from stiction.comparisons.bench.presentation import (
    LIMIT,
    TRUTH,
    Axis,
    Chart,
    HeatMap,
    MechanismPicture,
    Panel,
    Series,
)
from stiction.comparisons.bench.results import Results
from stiction.reports.figures.charts import CELL, draw, draw_figures, in_one_column
from stiction.reports.figures.style import (
    COLORS,
    COLUMNS,
    DASHES,
    FILLS,
    MARKERS,
    TALLEST,
    Drawing,
    looks_of,
    rc,
    save,
)
from stiction.reports.report import report_of
from stiction.scenes import InputError, load_scene
from stiction.scenes.pictures.picture import fit_labels

X = np.array([1e-3, 1e-2, 1e-1])
VARIANTS = {
    "reference": ("reference", "joint"),
    "paper's scheme": ("reference", "joint"),
    "other, contact": ("other", "contact"),
}
LOOKS = looks_of(VARIANTS)
SIGNS = {"right": ("+", "#009E73"), "wrong": ("x", "#D55E00"), "not run": (" ", "#FFFFFF")}


def errors() -> Chart:
    """Four panels with lines, points, intervals, a truth, a limit, shades and lines."""
    y = X**2
    lines = [
        Series("reference", X, y, 0.5 * y, 2 * y, "reference", points=True),
        Series("other", X, 3 * y, look="other, contact", line=False, points=True),
        Series("truth", X, y, look=TRUTH),
        Series("", X, 10 * y, look=LIMIT),
    ]
    logarithmic = Panel(
        "Case 1",
        Axis("step [s]", log=True, ticks=tuple(X)),
        Axis("error [m]", log=True),
        lines,
        shades=((2e-3, 5e-3),),
        lines=(1e-2,),
    )
    intervals = Panel(
        "Case 2",
        Axis("load [N]"),
        Axis("", ticks=(0, 1, 2), words=("a", "b", "c"), limits=(-0.5, 2.5)),
        [
            Series(
                "reference",
                X,
                np.arange(3.0),
                X - 1e-4,
                X + 2e-4,
                "reference",
                line=False,
                points=True,
            )
        ],
        horizontal=True,
    )
    return Chart(
        "errors",
        [logarithmic, intervals, logarithmic, logarithmic],
        caption="Errors fall with the step. More is in the text.",
    )


def hard() -> HeatMap:
    rows = [f"a case with a rather long name, number {number}" for number in range(12)]
    columns = [f"a method with a long name, contact {number}" for number in range(14)]
    cells = [
        ["right" if (x + y) % 3 else "" if x % 2 else "wrong" for x in range(14)] for y in range(12)
    ]
    return HeatMap(
        "hard",
        rows,
        columns,
        cells,
        SIGNS,
        {"First topic": 5, "Second topic": 7},
        caption="Where methods break down.",
    )


FIGURES = (
    errors(),
    hard(),
    MechanismPicture(
        "mechanism",
        load_scene("slider-bar-case-1"),
        caption="The mechanism.",
    ),
)


def saved(drawing: Drawing) -> Figure:
    drawing.figure.draw_without_rendering()
    return drawing.figure


@pytest.mark.parametrize("column", ["single", "double"])
@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.name)
def test_nothing_is_outside_of_a_figure_that_is_as_wide_as_asked_for(figure, column):
    with rc(column):
        made = saved(draw(figure, LOOKS))
        tight = made.get_tightbbox()
    assert made.get_figwidth() == pytest.approx(COLUMNS[column])
    assert (
        tight.x0 >= -0.02
        and tight.y0 >= -0.02
        and tight.x1 <= made.get_figwidth() + 0.02
        and tight.y1 <= made.get_figheight() + 0.02
    )


@pytest.mark.parametrize(
    "figure",
    (replace(errors(), panels=errors().panels[:1]), *FIGURES[1:]),
    ids=lambda figure: figure.name,
)
def test_same_data_same_bytes(figure, tmp_path):
    for place in (tmp_path / "one", tmp_path / "two"):
        place.mkdir()
        with rc():
            drawing = draw(figure, LOOKS)
        save(drawing, place, kinds=("png", "pdf", "svg"))
    for kind, begin in (("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")):
        one, two = (
            (tmp_path / name / f"{figure.name}.{kind}").read_bytes() for name in ("one", "two")
        )
        assert one == two and one.startswith(begin)
        assert (
            b"CreationDate" not in one
            and b"/Type3" not in one
            and b"/Subtype /Image" not in one
            and b"<image" not in one
        )


def test_points_and_intervals_are_where_the_data_are():
    with rc():
        first, second, *_ = saved(draw(errors(), LOOKS)).axes
    series = errors().panels[0].series
    drawn_lines = [
        line
        for line in first.lines
        if len(line.get_xdata()) == 3 and line.get_marker() not in ("_", "|")
    ]
    for one, line in zip(series, drawn_lines, strict=True):
        np.testing.assert_array_equal(line.get_data(), (one.x, one.y))
        assert (line.get_linestyle() == "None") != one.line
    for ax, (x, y), (low, high), across in (
        (first, (X, X**2), (0.5 * X**2, 2 * X**2), 1),
        (second, (X, np.arange(3.0)), (X - 1e-4, X + 2e-4), 0),
    ):
        [bars] = [
            collection for collection in ax.collections if isinstance(collection, LineCollection)
        ]
        ends = np.array(bars.get_segments())
        np.testing.assert_allclose(ends[:, 0, across], low)
        np.testing.assert_allclose(ends[:, 1, across], high)
        np.testing.assert_allclose(ends[:, :, 1 - across], np.array([(y, x)[across]] * 2).T)
    assert (first.get_xscale(), first.get_yscale(), second.get_xscale()) == ("log", "log", "linear")
    assert [label.get_text() for label in second.get_yticklabels()] == [
        "a",
        "b",
        "c",
    ] and second.get_ylim() == (-0.5, 2.5)


@pytest.mark.parametrize("column", ["single", "double"])
def test_no_two_labels_of_an_axis_touch(column):
    """On a logarithmic axis of less than two decades ``2 x 10^1 3 x 10^1`` once stood on each other."""
    narrow = Panel(
        "",
        Axis("to [s]", log=True, ticks=(15.0, 30.0, 60.0, 120.0, 240.0)),
        Axis("drift [m]", log=True),
        [Series("", np.array([15.0, 240.0]), np.array([1e-12, 2e-12]))],
    )
    with rc(column):
        for figure in (
            errors(),
            Chart(
                "narrow",
                [narrow] * 3,
                caption="Drift.",
            ),
        ):
            for ax in saved(draw(figure, LOOKS)).axes:
                for axis in (ax.xaxis, ax.yaxis):
                    boxes = [
                        tick.label1.get_window_extent()
                        for ticks in (axis.get_major_ticks(), axis.get_minor_ticks())
                        for tick in ticks
                        if tick.label1.get_visible() and tick.label1.get_text() and ax.axison
                    ]
                    assert not any(
                        one.overlaps(other)
                        for number, one in enumerate(boxes)
                        for other in boxes[:number]
                    ), figure.name


def test_a_heat_map_has_a_square_and_a_sign_for_every_cell_in_the_color_of_its_category():
    heat = hard()
    with rc():
        [ax] = saved(draw(heat, LOOKS)).axes
    shown = {
        (round(text.get_position()[0]), text.get_position()[1]): text.get_text()
        for text in ax.texts
        if text.get_fontstyle() != "italic"
    }
    lines = [0, *range(1, 6), 6, *range(7, 14)]
    places = {row: line for row, line in enumerate(line for line in lines if line not in (0, 6))}
    expected = {
        (x, places[y]): heat.categories[cell][0]
        for y, row in enumerate(heat.cells)
        for x, cell in enumerate(row)
        if cell
    }
    assert shown == expected and [
        text.get_text() for text in ax.texts if text.get_fontstyle() == "italic"
    ] == list(heat.groups)
    patches = {patch.get_facecolor(): patch for patch in ax.patches if isinstance(patch, PathPatch)}
    assert len(patches) == 2
    for patch in patches.values():
        centres = {(x, y) for x, y in expected if patch.get_path().contains_point((x, y))}
        [sign] = {expected[place] for place in centres}
        assert centres == {place for place, other in expected.items() if other == sign}
    assert (
        ax.get_ylim()[0] - ax.get_ylim()[1] == len(lines)
        and CELL * len(lines) < saved(Drawing("", "", ax.figure)).get_figheight()
    )


@settings(max_examples=25)
@given(
    st.dictionaries(
        st.text(min_size=1, max_size=12),
        st.tuples(
            st.sampled_from([f"engine {number}" for number in range(9)]),
            st.sampled_from(list(FILLS)),
        ),
        max_size=30,
    )
)
def test_no_two_variants_look_alike_with_and_without_colours(variants):
    try:
        looks = looks_of(variants)
    except InputError:
        engines = list(dict.fromkeys(engine for engine, _ in variants.values()))
        of_a_color = [
            sum(engines.index(engine) % len(COLORS) == place for engine, _ in variants.values())
            for place in range(len(COLORS))
        ]
        assert max(of_a_color) > len(DASHES) or max(
            [fidelity for _, fidelity in variants.values()].count(name) for name in FILLS
        ) > 2 * len(MARKERS)
        return
    assert list(looks) == list(variants)
    assert (
        len({(look.marker, look.fill) for look in looks.values()})
        == len({(look.color, str(look.dashes)) for look in looks.values()})
        == len(variants)
    )
    assert all(
        looks[one].color == looks[two].color
        for one in variants
        for two in variants
        if variants[one][0] == variants[two][0]
    )


def test_too_many_variants_are_refused_in_words():
    with pytest.raises(
        InputError, match="found 29 variants; expected at most 10 of a colour, and 28 of a fidelity"
    ):
        looks_of({f"variant {number}": (f"engine {number}", "joint") for number in range(29)})


def test_a_variant_looks_the_same_in_all_figures_of_a_run(validation):
    def of(*labels: str) -> Chart:
        return Chart(
            "-".join(labels),
            [Panel("", Axis(), Axis(), [Series(label, X, X, look=label) for label in labels])],
            caption="C.",
        )

    with rc():
        one, two = draw_figures([of("reference", "other"), of("other")], validation)
    assert (
        one.figure.axes[0].lines[1].get_color()
        == two.figure.axes[0].lines[0].get_color()
        != one.figure.axes[0].lines[0].get_color()
    )


@pytest.mark.parametrize(
    "panels", [[], [Panel("", Axis(), Axis(), [])]], ids=["no panel", "no series"]
)
def test_figures_of_nothing(panels: Sequence[Panel]):
    with rc():
        assert (
            saved(
                draw(
                    Chart(
                        "nothing",
                        panels,
                        caption="Nothing.",
                    ),
                    {},
                )
            ).axes
            is not None
            if panels
            else list(draw_figures([], Results((), {}, {}))) == []
        )


def test_another_kind_of_figure_is_refused_in_words():
    with pytest.raises(TypeError, match="found a str; expected Chart, HeatMap or MechanismPicture"):
        draw("a figure", {})


def tall(count: int, columns: int, series: int = 2) -> Chart:
    """Panels in rows of so many, labelled at the edges of the chart alone."""
    lines = [
        Series(f"method {number}", X, (1 + number) * X, look=f"method {number}")
        for number in range(series)
    ]
    panels = [
        Panel(
            f"panel {number}",
            Axis("time [s]" if number >= count - columns else "", log=True),
            Axis("drift of the joints [m, rad]" if number % columns == 0 else "", log=True),
            lines,
        )
        for number in range(count)
    ]
    return Chart(
        "tall",
        panels,
        columns,
        share_x=True,
        caption="Drift of all methods. More of it is in the text.",
    )


@pytest.mark.parametrize(
    "figure",
    [
        tall(12, 3),
        tall(6, 3),
        tall(7, 2),
        tall(12, 6),
        tall(4, 1, series=25),
        tall(1, 1),
        errors(),
        hard(),
        replace(
            hard(),
            rows=[f"case {number}" for number in range(90)],
            cells=[["right"] * 14] * 90,
            groups={"First": 5, "Second": 85},
        ),
        replace(
            hard(),
            rows=[f"case {number}" for number in range(90)],
            cells=[["right"] * 14] * 90,
            groups={},
        ),
        FIGURES[2],
    ],
    ids=lambda figure: figure.name,
)
def test_in_one_column_every_part_of_a_figure_fits_a_page_and_none_is_lost(figure):
    parts = in_one_column(figure)
    assert len({part.name for part in parts}) == len(parts) and all(
        part.caption.startswith(figure.caption.partition(". ")[0].rstrip(".")) for part in parts
    )
    assert (len(parts) == 1) == (parts[0].name == figure.name)
    if isinstance(figure, Chart):
        assert [panel.title for part in parts for panel in part.panels] == [
            panel.title for panel in figure.panels
        ]
        assert all(
            panel.x.label and (panel.y.label or panel.y.words)
            for part in parts
            for panel in part.panels
        )
    if isinstance(figure, HeatMap):
        assert [row for part in parts for row in part.rows] == list(figure.rows) and all(
            len(part.rows) == len(part.cells) for part in parts
        )
        assert {
            heading: sum(part.groups.get(heading, 0) for part in parts) for heading in figure.groups
        } == dict(figure.groups)
    for drawing in drawn_in_one_column(parts):
        assert (
            drawing.figure.get_figwidth() == pytest.approx(COLUMNS["single"])
            and drawing.figure.get_figheight() <= TALLEST + 1e-9
        ), drawing.name


def drawn_in_one_column(figures):
    """Drawn one after the other, as they are in a paper."""
    with rc("single"):
        for drawing in draw_figures(figures, Results((), {}, {})):
            fit_labels(drawing.figure)
            yield drawing


def test_figures_of_a_run_fit_a_page_in_both_widths(validation):
    report = report_of(validation)
    assert report.figures
    for column, figures in (
        ("single", [part for figure in report.figures for part in in_one_column(figure)]),
        ("double", report.figures),
    ):
        with rc(column):
            assert all(
                drawing.figure.get_figheight() <= TALLEST + 1e-9
                for drawing in draw_figures(figures, validation)
            )


@pytest.mark.parametrize("column", ["single", "double"])
def test_long_labels_are_broken_and_touch_no_other(column):
    long = Panel(
        "A title that is by far longer than its panel is wide, with every condition of it",
        Axis("largest distance of the slider from where the truth has it, relative to its own [-]"),
        Axis("threshold on the load amplitude F0, less that of the truth [N]"),
        [Series("", X, X)],
    )
    named = replace(
        long, y=replace(long.y, label="a_very_long_name_of_a_guide.normal_force_at_corner [N]")
    )
    for panels in ([long], [long, named], [long, named, long, named]):
        with rc(column):
            drawing = draw(
                Chart(
                    "long",
                    panels,
                    columns=2,
                    caption="L.",
                ),
                {},
            )
            fit_labels(drawing.figure)
            made = saved(drawing)
        boxes = [
            text.get_window_extent()
            for ax in made.axes
            for text in (ax.xaxis.label, ax.yaxis.label, ax.title, ax._left_title)
            if text.get_text()
        ]
        inside = made.bbox
        assert len(boxes) == 3 * len(panels)
        assert all(
            box.x0 >= inside.x0 - 1
            and box.x1 <= inside.x1 + 1
            and box.y0 >= inside.y0 - 1
            and box.y1 <= inside.y1 + 1
            for box in boxes
        )
        assert not any(
            one.overlaps(other) for number, one in enumerate(boxes) for other in boxes[:number]
        )
        words = [ax.yaxis.label.get_text().replace("\n", "").replace(" ", "") for ax in made.axes]
        assert words == [panel.y.label.replace(" ", "") for panel in panels]
