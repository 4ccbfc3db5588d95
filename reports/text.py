"""Text of reports: Jinja2 templates in Markdown, filled with rows of the data.

Each study has a template ``templates/studies/NAME.md``, which consists of these blocks, all optional:

``answer``
    One or two sentences that answer the study's question. A terminal and page one show them.
``beside``
    Text that page one adds after the answer.
``findings``
    The paragraphs of the study's section, separated by empty lines.
``figures``, ``tables``
    The caption of each figure and table: ``{% call caption("drift") %}Largest drift ..{% endcall %}``.
``notes``
    A list of explanations of the figures and tables: definitions, signs, what may be compared.

A template reads the entries of ``Presentation.rows`` by name. A name that does not exist is an error.
The functions that are registered in `_environment` as filters format the numbers in a template.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from functools import cache

from jinja2 import (
    Environment,
    PackageLoader,
    StrictUndefined,
    Template,
    TemplateNotFound,
    pass_context,
)
from jinja2.runtime import Context

from stiction.comparisons.bench.presentation import Figure, Headline, Presentation, TableView
from stiction.comparisons.bench.presentation.cells import cell, intervals_in_words, setting_of
from stiction.comparisons.bench.presentation.rows import Cell, Row
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Study
from stiction.comparisons.bench.timing.intervals import Interval
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.wording import names
from stiction.uncertain import Uncertain, bounded, rounded_down, rounded_up, with_ends

MILLI = 1e3
"""Number of thousandths in a unit: milliseconds in a second, millimetres in a metre."""
PER_CENT = 100.0
"""Number of per cent in a whole."""
MIN_LENGTH_IN_MM = 1e-6
"""Shortest length that is written in millimetres, in metres: a thousandth of a millimetre."""
MAX_DECIMALS = 12
"""Decimals of a number without an uncertainty, where numbers show all digits that are known."""
MAX_PLAIN_NUMBER = 1e6
"""Numbers below this one are written without an exponent: 980 and not 9.8e+02."""
NUMBERS = "shown_numbers"
"""Template variable that contains the list of numbers written by the filters."""
TITLE_OF = "title_of_scene"
"""Template variable that contains the function that returns the title of a scene from its name."""


@dataclass(frozen=True)
class Number:
    """A number that a template has written.

    Attributes
    ----------
    text : str
        The number as it is written, without its unit.
    cell : Cell
        The cell of the data that contains the number.
    factor : float
        Factor between the cell and the number in the text: 1000 for a time in ms.
    """

    text: str
    cell: Cell
    factor: float = 1.0


@dataclass(frozen=True)
class Section:
    """The text, tables and figures of a study, which renderers show without knowing the study.

    Attributes
    ----------
    answer, beside : str
        One line of Markdown each; empty if there is none.
    findings, notes : sequences of str
        Paragraphs, and items of a list.
    headlines, tables, figures : sequences
        The headlines, tables and figures of the presentation, with their captions.
    numbers : sequence of Number
        The numbers that the text contains.
    """

    answer: str = ""
    beside: str = ""
    findings: Sequence[str] = ()
    headlines: Sequence[Headline] = ()
    tables: Sequence[TableView] = ()
    figures: Sequence[Figure] = ()
    notes: Sequence[str] = ()
    numbers: Sequence[Number] = ()

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to show; the report then has no section for the study."""
        return not (self.answer or self.findings or self.tables or self.figures)


def section_of(study: Study, results: Results) -> Section:
    """Return the section of a study about the results of a run, which may be a stored run."""
    return fill_template(_template_of(study), study.presented(results), results.title_of)


def fill_template(
    template: Template, presentation: Presentation, title_of: Callable[[str], str] = str
) -> Section:
    """Return the section that a template makes of the rows, tables and figures of a presentation.

    `title_of` returns the title of a scene from its name.
    """
    if presentation.is_empty:
        return Section()
    # The filters append each number that they write to this list.
    numbers: list[Number] = []
    variables = {**presentation.rows, NUMBERS: numbers, TITLE_OF: title_of}
    texts = render_blocks(template, variables, "answer", "beside", "findings", "notes")
    figure_names = [figure.name for figure in presentation.figures]
    figure_captions = _captions(template, variables, "figures", figure_names)
    table_names = [view.name for view in presentation.tables]
    table_captions = _captions(template, variables, "tables", table_names)
    # The notes explain tables and figures, and are left out where there are none.
    notes: Sequence[str] = ()
    if presentation.tables or presentation.figures:
        notes = items(texts.get("notes", ""))
    return Section(
        answer=one_line(texts.get("answer", "")),
        beside=one_line(texts.get("beside", "")),
        findings=paragraphs(texts.get("findings", "")),
        headlines=presentation.headlines,
        tables=[replace(view, caption=table_captions[view.name]) for view in presentation.tables],
        figures=[
            replace(figure, caption=figure_captions[figure.name]) for figure in presentation.figures
        ],
        notes=notes,
        numbers=numbers,
    )


def _captions(
    template: Template, variables: Mapping[str, object], block: str, shown: Iterable[str]
) -> dict[str, str]:
    """Return the captions in a block, by the name of the figure or table.

    Without the block, the captions of all figures or tables in `shown` are empty.

    Raises
    ------
    ValueError
        If the block has no caption for a figure or table in `shown`, or two captions for one.
    """
    if block not in template.blocks:
        return dict.fromkeys(shown, "")
    captions: dict[str, str] = {}

    def caption(name: str, caller: Callable[[], str]) -> str:
        """Store the text between ``{% call caption(name) %}`` and ``{% endcall %}``."""
        if name in captions:
            raise ValueError(f"captions: found two of {name!r}; expected one for each name")
        captions[name] = one_line(caller())
        return ""

    # Rendering calls `caption` for each caption; the text of the block itself is not used.
    render_blocks(template, {**variables, "caption": caption}, block)
    missing = [name for name in shown if name not in captions]
    if missing:
        raise ValueError(
            f"{block}: found no caption of {', '.join(missing)}; expected one of each, found those of "
            f"{', '.join(captions) or 'none'}"
        )
    return captions


def render_blocks(
    template: Template, variables: Mapping[str, object], *names: str
) -> dict[str, str]:
    """Return the text of the named blocks of a template, or of all blocks if no name is given."""
    context = template.new_context(dict(variables))
    return {
        name: "".join(block(context))
        for name, block in template.blocks.items()
        if not names or name in names
    }


def one_line(text: str) -> str:
    """Return a text on one line, with single spaces and no space before punctuation.

    A condition in a template that is false leaves spaces, or a space before a full stop or comma.
    """
    return re.sub(r" (?=[.,;:](?: |$))", "", " ".join(text.split()))


def paragraphs(text: str) -> list[str]:
    """Return the paragraphs of a text, which are separated by empty lines, on one line each."""
    return [one_line(part) for part in re.split(r"\n\s*\n", text) if part.strip()]


def items(text: str) -> list[str]:
    """Return the items of a Markdown list, on one line each."""
    return [one_line(part) for part in re.split(r"(?m)^\s*- ", text) if part.strip()]


def template(name: str) -> Template:
    """Return a template by its path in ``templates``."""
    return _environment().get_template(name)


def _template_of(study: Study) -> Template:
    """Return the template of a study: its file in ``templates``, or else ``Study.text``."""
    try:
        return template(f"studies/{study.name}.md")
    except TemplateNotFound:
        return _environment().from_string(study.text)


@cache
def _environment() -> Environment:
    """Return the Jinja2 environment of all templates, with the filters of this module."""
    environment = Environment(
        loader=PackageLoader("stiction.reports"),
        undefined=StrictUndefined,
        autoescape=False,  # the text is Markdown; pages escape it when they convert it
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        quantity=quantity,
        number=number,
        milli=milli,
        interval=interval,
        ratio=ratio,
        listed=listed,
        setting=setting,
        scene_title=scene_title,
        first_upper=first_upper,
        cardinal=cardinal,
        within=within,
        milliseconds=milliseconds,
        percent=percent,
        magnitude=magnitude,
        upper_bound=upper_bound,
        safe_length=safe_length,
        known_digits=known_digits,
        enclosure=enclosure,
        in_words=in_words,
        intervals=intervals,
        names=names,
    )
    environment.globals["Fidelity"] = Fidelity
    return environment


def _record(context: Context, text: str, source: Cell, factor: float = 1.0) -> str:
    """Record the cell that a number in the text comes from, and return the text."""
    context[NUMBERS].append(Number(text, source, factor))
    return text


def intervals(text: str, separator: str) -> str:
    """Write the intervals in a cell: ``3.77 to 4.54 N and 5 to 6`` with the separator ``" N and "``."""
    return separator.join(intervals_in_words(text))


def in_words(value: str, key: str) -> str:
    """Write the value of a category, such as a tier of truth, as in tables; `key` names the quantity."""
    return cell(quantity_of(key), value)


@pass_context
def quantity(context: Context, source: Cell) -> str:
    """Write a number with its unit: ``0.24 mm``, ``1.3e-11 m``.

    Lengths of `MIN_LENGTH_IN_MM` or more are written in millimetres.
    """
    if source.quantity.unit == "m" and abs(source.value) >= MIN_LENGTH_IN_MM:
        if source.uncertainty is None:
            return f"{milli(context, source)} mm"
        scaled = Uncertain(abs(MILLI * source.value), MILLI * source.uncertainty)
        return f"{_record(context, str(scaled), source, MILLI)} mm"
    unit = f" {source.quantity.unit}" if source.quantity.unit else ""
    return f"{number(context, source)}{unit}"


@pass_context
def number(context: Context, source: Cell | float, form: str = "") -> str:
    """Write a number without its unit.

    The quantity of a cell determines the number of digits, unless `form` is a format such as ``".3g"``.
    """
    if not isinstance(source, Cell):
        return _format_plainly(float(source), form or ".6g")
    text = _format_plainly(source.value, form) if form else str(source)
    return _record(context, text, source)


@pass_context
def milli(context: Context, source: Cell, sign: str = "") -> str:
    """Write a number in thousandths of its unit (a time in ms, a length in mm) to two digits, after its sign.

    If the sign makes the number a bound, as in ``≤ 1.1``, the number is rounded so that the bound holds.
    """
    return _record(context, bounded(MILLI * source.value, sign), source, MILLI)


@pass_context
def milliseconds(context: Context, source: Cell) -> str:
    """Write a step size, which is an exact number of seconds, in ms with all its digits: ``12.5``."""
    return _record(context, f"{MILLI * source.value:g}", source, MILLI)


@pass_context
def percent(context: Context, source: Cell, bound: str | None = None) -> str:
    """Write a fraction in per cent, to two digits and always with its sign: ``+0.12``.

    After the sign ``≤`` or ``≥`` it is rounded so that the bound holds: ``≥ +12`` for at least 12.8 %.
    """
    value = PER_CENT * source.value
    if not bound:
        return _record(context, f"{value:+.2g}", source, PER_CENT)
    sign = "-" if value < 0 else "+"
    # The magnitude of an upper bound grows if the number is positive, and shrinks if it is negative.
    magnitude_grows = (bound == "≤") == (value > 0)
    size = rounded_up(abs(value)) if magnitude_grows else rounded_down(abs(value))
    return _record(context, f"{bound} {sign}{size}", source, PER_CENT)


@pass_context
def interval(context: Context, source: Cell, signed: bool = True) -> str:
    """Write a number, or its magnitude if not `signed`, with its uncertainty: ``-0.035 ± 0.063``."""
    value = source.value if signed else abs(source.value)
    text = Uncertain(value, source.uncertainty or 0.0).both()
    return _record(context, text, source)


def ratio(interval: Interval) -> str:
    """Write a ratio with its interval, ``19.6 (19.3 to 20.1)``, or ``~19.6`` for a single sample."""
    is_single = interval.samples == 1
    return with_ends(interval.value, interval.low, interval.high, is_single)


def listed(parts: Iterable[object], separator: str = ", ", last: str = " and ") -> str:
    """Join parts as in ``a, b and c``."""
    *first, end = map(str, parts)
    return f"{separator.join(first)}{last}{end}" if first else end


@pass_context
def scene_title(context: Context, scene: str) -> str:
    """Write the title of a scene, or its name if it has no title."""
    return context[TITLE_OF](scene)


def setting(row: Row) -> str:
    """Write the step size or tolerance of a run, ``dt = 0.001 s``; empty if the row has none."""
    step = row["step"]
    if not isinstance(step, Cell):
        return ""
    return setting_of(str(row["parameter"]), float(step))


def first_upper(text: str) -> str:
    """Return a text with its first letter as a capital and the other letters unchanged."""
    return text[:1].upper() + text[1:]


def cardinal(count: int) -> str:
    """Write the numbers 1 to 3 as words, and other numbers in digits."""
    return {1: "one", 2: "two", 3: "three"}.get(count, str(count))


@pass_context
def within(context: Context, row: Row, column: str) -> str:
    """Write a number of a row with its interval: ``19.6 (19.3 to 20.1)``.

    The ends of the interval are in the columns ``<column>_low`` and ``<column>_high``. Ends that are
    equal belong to a single sample, which has no interval: ``~19.6``.
    """
    source = row.number(column)
    low = row.number(f"{column}_low").value
    high = row.number(f"{column}_high").value
    text = with_ends(source.value, low, high, is_single=low == high)
    return _record(context, text, source)


def _format_plainly(value: float, form: str) -> str:
    """Format a number by `form`, but numbers below `MAX_PLAIN_NUMBER` without an exponent."""
    text = format(value, form)
    if form.endswith("g") and abs(value) < MAX_PLAIN_NUMBER:
        return f"{float(text):g}"
    return text


@pass_context
def magnitude(context: Context, source: Cell, form: str) -> str:
    """Write the magnitude of a number by a format such as ``".3g"``."""
    return _record(context, _format_plainly(abs(source.value), form), source)


@pass_context
def upper_bound(context: Context, source: Cell) -> str:
    """Write a number to two digits, rounded up, so that it remains an upper bound."""
    return _record(context, rounded_up(source.value), source)


@pass_context
def safe_length(context: Context, source: Cell) -> str:
    """Write a length in mm to two digits, rounded down, so that it remains a lower bound: ``0.23 mm``."""
    return _record(context, f"{rounded_down(MILLI * source.value)} mm", source, MILLI)


@pass_context
def known_digits(context: Context, source: Cell) -> str:
    """Write the decimals of a number that are known: ``4.211956`` if its uncertainty is 4e-7.

    A unit in the last decimal is at least twice the uncertainty.
    """
    uncertainty = source.uncertainty or 0.0
    decimals = MAX_DECIMALS
    if uncertainty > 0:
        decimals = max(0, math.floor(-math.log10(2 * uncertainty)))
    return _record(context, f"{source.value:.{decimals}f}", source)


@pass_context
def enclosure(context: Context, source: Cell, between: str = " to ") -> str:
    """Write the interval of a number and its uncertainty, rounded outwards: ``4.211956322 to 4.211956323``.

    The ends are computed from the shortest decimal representations of the two numbers. Since proven
    ends are decimals, they are written as they were proven.
    """
    value = Decimal(repr(source.value))
    uncertainty = Decimal(repr(source.uncertainty or 0.0))
    # Two digits of the uncertainty are kept; an exact number keeps all of its own digits.
    last_place = int(value.as_tuple().exponent)
    if uncertainty:
        last_place = uncertainty.adjusted() - 1
    unit = Decimal(1).scaleb(last_place)
    low = (value - uncertainty).quantize(unit, ROUND_FLOOR).normalize()
    high = (value + uncertainty).quantize(unit, ROUND_CEILING).normalize()
    return _record(context, f"{low:f}{between}{high:f}", source)
