"""Text of reports: Jinja2 templates in Markdown, filled with rows of the data.

Each study has a template ``templates/studies/NAME.md`` of these blocks, of which it may leave out any:

``answer``
    One sentence or two that answer the study's question, on one line of a terminal and on page one.
``beside``
    What page one says behind the answer.
``findings``
    Paragraphs of the study's section, between empty lines.
``figures``, ``tables``
    The caption of each figure and table: ``{% call caption("drift") %}Largest drift of ..{% endcall %}``.
``notes``
    A list of how to read figures and tables: definitions, signs, what may be compared.

A template reads ``Presentation.rows`` by name. What it names must be there: a misspelt name is an error.
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

from stiction.comparisons.bench.methods import scene_title
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
"""Thousandths in a unit: milliseconds in a second, millimetres in a metre."""
PER_CENT = 100.0
"""Per cent in a whole."""
MILLIMETRES = 1e-6
"""Metres; lengths from here on are written in mm."""
MOST_DECIMALS = 12
"""Decimals of a number without an uncertainty, of those that are written as far as they are known."""
SHOWN = "shown_numbers"
"""Name in a template's variables of the list of numbers that its filters have written."""


@dataclass(frozen=True)
class Number:
    """A number that a template has written, and the cell that it is from.

    `factor` multiplies the cell: 1000 for a time in ms.
    """

    text: str
    cell: Cell
    factor: float = 1.0


@dataclass(frozen=True)
class Section:
    """A study in words, tables and figures, for renderers that know no study by name.

    Attributes
    ----------
    answer, beside : str
        One line each, in Markdown; empty if there is none.
    findings, notes : sequences of str
        Paragraphs, and items of a list.
    headlines, tables, figures : sequences
        Those of the presentation, with their captions.
    numbers : sequence of Number
        The numbers in the words.
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
        """Nothing to show: then the report has no section of the study."""
        return not (self.answer or self.findings or self.tables or self.figures)


def section_of(study: Study, results: Results) -> Section:
    """Return what a study says of the results, which may be those of a stored run."""
    return written(_template_of(study), study.presented(results))


def written(template: Template, said: Presentation) -> Section:
    """Fill a template with the rows of a presentation."""
    if said.is_empty:
        return Section()
    numbers: list[Number] = []
    variables = {**said.rows, SHOWN: numbers}
    words = filled(template, variables, "answer", "beside", "findings", "notes")
    figures = _captions(template, variables, "figures", [each.name for each in said.figures])
    tables = _captions(template, variables, "tables", [view.name for view in said.tables])
    has_more_than_words = bool(said.tables or said.figures)
    return Section(
        one_line(words.get("answer", "")),
        one_line(words.get("beside", "")),
        paragraphs(words.get("findings", "")),
        said.headlines,
        [replace(view, caption=tables[view.name]) for view in said.tables],
        [replace(each, caption=figures[each.name]) for each in said.figures],
        items(words.get("notes", "")) if has_more_than_words else (),
        numbers,
    )


def _captions(
    template: Template, variables: Mapping[str, object], block: str, shown: Iterable[str]
) -> dict[str, str]:
    """Return the captions that a block gives, by name of the figure or table; all are empty without the block.

    Raises
    ------
    ValueError
        If the block has no caption of a figure or table that is shown, or two of one.
    """
    if block not in template.blocks:
        return dict.fromkeys(shown, "")
    captions: dict[str, str] = {}

    def caption(name: str, caller: Callable[[], str]) -> str:
        if name in captions:
            raise ValueError(f"captions: found two of {name!r}; expected one for each name")
        captions[name] = one_line(caller())
        return ""

    filled(template, {**variables, "caption": caption}, block)
    if missing := [name for name in shown if name not in captions]:
        raise ValueError(
            f"{block}: found no caption of {', '.join(missing)}; expected one of each, found those of "
            f"{', '.join(captions) or 'none'}"
        )
    return captions


def filled(template: Template, variables: Mapping[str, object], *names: str) -> dict[str, str]:
    """Return the text of the blocks of a template; of all where no name is given."""
    context = template.new_context(dict(variables))
    return {
        name: "".join(block(context))
        for name, block in template.blocks.items()
        if name in names or not names
    }


def one_line(text: str) -> str:
    """Return the text with single spaces in place of breaks and of what a condition has left empty.

    A condition between a word and a full stop or comma leaves no space before it.
    """
    return re.sub(r" (?=[.,;:](?: |$))", "", " ".join(text.split()))


def paragraphs(text: str) -> list[str]:
    """Return the paragraphs of a text, which empty lines part, on one line each."""
    return [one_line(part) for part in re.split(r"\n\s*\n", text) if part.strip()]


def items(text: str) -> list[str]:
    """Return the items of a Markdown list, on one line each."""
    return [one_line(part) for part in re.split(r"(?m)^\s*- ", text) if part.strip()]


def template(name: str) -> Template:
    """Return a template by its path in ``templates``."""
    return _environment().get_template(name)


def _template_of(study: Study) -> Template:
    """The text of a study: that of its file, else its own, which may be empty."""
    try:
        return template(f"studies/{study.name}.md")
    except TemplateNotFound:
        return _environment().from_string(study.text)


@cache
def _environment() -> Environment:
    found = Environment(
        loader=PackageLoader("stiction.reports"),
        undefined=StrictUndefined,
        autoescape=False,  # the text is Markdown; pages escape it when they convert it
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters.update(
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
        known_digits=known_digits,
        enclosure=enclosure,
        in_words=in_words,
        intervals=intervals,
        names=names,
    )
    found.globals["Fidelity"] = Fidelity
    return found


def _noted(context: Context, text: str, written: Cell, factor: float = 1.0) -> str:
    """Keep which cell a text is from."""
    context[SHOWN].append(Number(text, written, factor))
    return text


def intervals(text: str, separator: str) -> str:
    """Write the intervals in a cell: ``3.77 to 4.54 N and 5 to 6`` with the separator ``" N and "``."""
    return separator.join(intervals_in_words(text))


def in_words(value: str, key: str) -> str:
    """Write the value of a category, such as a tier of truth, as tables do; `key` is that of the quantity."""
    return cell(quantity_of(key), value)


@pass_context
def quantity(context: Context, given: Cell) -> str:
    """Write a number with its unit; a length in mm from a thousandth of one on: ``0.24 mm``, ``1.3e-11 m``."""
    if given.quantity.unit == "m" and abs(given.value) >= MILLIMETRES:
        if given.uncertainty is None:
            return f"{milli(context, given)} mm"
        scaled = Uncertain(abs(MILLI * given.value), MILLI * given.uncertainty)
        return f"{_noted(context, str(scaled), given, MILLI)} mm"
    unit = f" {given.quantity.unit}" if given.quantity.unit else ""
    return f"{number(context, given)}{unit}"


@pass_context
def number(context: Context, given: Cell | float, form: str = "") -> str:
    """Write a number without its unit, with the digits of its kind or by a format such as ``".3g"``."""
    if not isinstance(given, Cell):
        return _formatted(float(given), form or ".6g")
    text = _formatted(given.value, form) if form else str(given)
    return _noted(context, text, given)


@pass_context
def milli(context: Context, given: Cell, sign: str = "") -> str:
    """Write a number in a thousandth of its unit, to two digits, behind its sign: a time in ms, a length in mm.

    A number behind a sign of a bound, ``≤ 1.1``, is rounded so that it stays one.
    """
    return _noted(context, bounded(MILLI * given.value, sign), given, MILLI)


@pass_context
def milliseconds(context: Context, given: Cell) -> str:
    """Write a step, which is an exact number of seconds, in ms with all its digits: ``12.5``."""
    return _noted(context, f"{MILLI * given.value:g}", given, MILLI)


@pass_context
def percent(context: Context, given: Cell, bound: str | None = None) -> str:
    """Write a part of a whole in per cent, to two digits and always with its sign: ``+0.12``.

    Behind ``≤`` or ``≥`` it is rounded so that it remains a bound: ``≥ +12`` for at least 12.8 %.
    """
    value = PER_CENT * given.value
    if not bound:
        return _noted(context, f"{value:+.2g}", given, PER_CENT)
    grows = (bound == "≤") == (value > 0)
    size = rounded_up(abs(value)) if grows else rounded_down(abs(value))
    return _noted(context, f"{bound} {'-' if value < 0 else '+'}{size}", given, PER_CENT)


@pass_context
def interval(context: Context, given: Cell, signed: bool = True) -> str:
    """Write a number, with its sign or by its size, and its uncertainty: ``-0.035 ± 0.063``."""
    value = given.value if signed else abs(given.value)
    text = Uncertain(value, given.uncertainty or 0.0).both()
    return _noted(context, text, given)


def ratio(given: Interval) -> str:
    """Write a ratio with its interval: ``19.6 (19.3 to 20.1)``; one sample has none: ``~19.6``."""
    return with_ends(given.value, given.low, given.high, is_single=given.samples == 1)


def listed(parts: Iterable[object], separator: str = ", ", last: str = " and ") -> str:
    """Write ``a, b and c``."""
    *first, end = map(str, parts)
    return f"{separator.join(first)}{last}{end}" if first else end


def setting(row: Row) -> str:
    """Write the step or tolerance of a run: ``dt = 0.001 s``."""
    step = row["step"]
    return setting_of(str(row["parameter"]), float(step)) if isinstance(step, Cell) else ""


def first_upper(text: str) -> str:
    """Write the first letter as a capital, and leave the others as they are."""
    return text[:1].upper() + text[1:]


def cardinal(count: int) -> str:
    """Write a small number in words."""
    return {1: "one", 2: "two", 3: "three"}.get(count, str(count))


@pass_context
def within(context: Context, given: Row, column: str) -> str:
    """Write a number of a row with its interval, the columns with the endings ``_low`` and ``_high``.

    ``19.6 (19.3 to 20.1)``; ``~19.6`` where the ends coincide: a single sample has no interval.
    """
    value, low, high = (given.number(f"{column}{end}") for end in ("", "_low", "_high"))
    return _noted(
        context,
        with_ends(value.value, low.value, high.value, is_single=low.value == high.value),
        value,
    )


def _formatted(value: float, form: str) -> str:
    """``980`` where the format alone would write ``9.8e+02``."""
    text = format(value, form)
    return f"{float(text):g}" if form.endswith("g") and abs(value) < 1e6 else text


@pass_context
def magnitude(context: Context, given: Cell, form: str) -> str:
    """Write the size of a number by a format, without its sign."""
    return _noted(context, _formatted(abs(given.value), form), given)


@pass_context
def upper_bound(context: Context, given: Cell) -> str:
    """Write a number to two digits, rounded up, so that an upper bound remains one."""
    return _noted(context, rounded_up(given.value), given)


@pass_context
def known_digits(context: Context, given: Cell) -> str:
    """Write a number with the decimals that its uncertainty leaves: ``4.211956`` of one known to 4e-7.

    The last decimal that is written is at least twice the uncertainty.
    """
    unsure = given.uncertainty or 0.0
    decimals = max(0, math.floor(-math.log10(2 * unsure))) if unsure > 0 else MOST_DECIMALS
    return _noted(context, f"{given.value:.{decimals}f}", given)


@pass_context
def enclosure(context: Context, given: Cell, between: str = " to ") -> str:
    """Write the interval of a number and its uncertainty, rounded outwards: ``4.211956322 to 4.211956323``.

    The ends are sums of the shortest decimals of both numbers, so that those of a proof, which are decimals, are
    written as they were proven.
    """
    value = Decimal(repr(given.value))
    unsure = Decimal(repr(given.uncertainty or 0.0))
    last = unsure.adjusted() - 1 if unsure else int(value.as_tuple().exponent)
    unit = Decimal(1).scaleb(last)
    low = (value - unsure).quantize(unit, ROUND_FLOOR).normalize()
    high = (value + unsure).quantize(unit, ROUND_CEILING).normalize()
    return _noted(context, f"{low:f}{between}{high:f}", given)
