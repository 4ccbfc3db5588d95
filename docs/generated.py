"""Generates the parts of the documentation that follow from the code: ``python docs/generated.py``.

A generated part of a page is between the lines ``<!-- generated: NAME ARGUMENTS -->`` and ``<!-- end -->``;
NAME is a key of `GENERATED`. Tests check that the pages are up to date.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from stiction.cli.app import app
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.judge.submission import COLUMNS as SUBMISSION_COLUMNS
from stiction.comparisons.judge.submission import Verdict
from stiction.comparisons.regression import history
from stiction.engines import EngineMissing, load_engine
from stiction.engines.listing import default_settings, fidelity_rows
from stiction.engines.program.declaration import PLACEHOLDERS
from stiction.reference_impl import paper
from stiction.reference_impl.friction.outcomes import BREAKDOWNS
from stiction.scenes import catalogue, load_scene, new_scene_text
from stiction.scenes.columns import COLUMNS
from stiction.scenes.errors import ELEMENTS, LAWS, STABILIZATIONS
from stiction.scenes.expressions import CONSTANTS, FUNCTIONS
from stiction.scenes.fields import TAGS
from stiction.scenes.model import Scene

PART = re.compile(
    r"^(?P<begin><!-- generated: (?P<call>[\w. -]+) -->\n).*?(?P<end>^<!-- end -->$)",
    re.MULTILINE | re.DOTALL,
)
"""A generated part of a page. The call consists of a key of `GENERATED` and arguments."""
SOLVERS = Path(__file__).parent / "examples" / "solvers"


def regenerated(page: str) -> str:
    """Return the text of a page with new generated parts.

    The part of an engine that is not installed is not changed.
    """
    return PART.sub(_new_part, page)


def _new_part(match: re.Match[str]) -> str:
    """Return the new text of a generated part."""
    name, *arguments = match["call"].split()
    try:
        content = GENERATED[name](*arguments).strip()
    except EngineMissing:
        return match[0]
    return f"{match['begin']}\n{content}\n\n{match['end']}"


def write(folder: Path) -> None:
    """Write the generated parts of all pages in a folder."""
    for path in folder.rglob("*.md"):
        path.write_text(regenerated(path.read_text(encoding="utf-8")), encoding="utf-8")


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    heading, *lines = [
        " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line)
        for line in (columns, *rows)
    ]
    rule = " | ".join(["---"] * len(columns))
    return "".join(f"| {line} |\n" for line in (heading, rule, *lines))


def scene_format() -> str:
    """Return a section for the top of a scene file and for every kind of element, law and stabilization."""
    parts = [("Top of the file", Scene), ("`[bodies.NAME]`", *ELEMENTS["bodies"].values())]
    for section in ("joints", "drives", "springs", "forces"):
        for tag, model in ELEMENTS[section].items():
            title = f"`[{section}.NAME]`"
            if tag:
                title += f', `type = "{tag}"`'
            parts.append((title, model))
    for tag, model in LAWS.items():
        parts.append((f'`law = {{ type = "{tag}", .. }}`', model))
    for tag, model in STABILIZATIONS.items():
        parts.append((f'`[stabilization]`, `method = "{tag}"`', model))
    return "\n".join(f"### {title}\n\n{_text(model)}\n\n{_keys(model)}" for title, model in parts)


def _keys(model: type[BaseModel]) -> str:
    """Return a table of the keys of an element in a scene file."""
    rows = [
        (f"`{key}`", _default(field), field.description or "")
        for key, field in model.model_fields.items()
    ]
    # the key that names the class has a default in Python only
    first_key = next(iter(model.model_fields))
    if first_key in TAGS:
        _, _, description = rows[0]
        rows[0] = (f"`{first_key}`", "required", description)
    return _table(("key", "default", "description"), rows)


def _default(field: FieldInfo) -> str:
    """Return the default of a key as it would be written in a scene file."""
    if field.is_required():
        return "required"
    default = field.default
    if isinstance(default, BaseModel):
        return f'`method = "{default.method}"`'
    if default == "":
        return "empty"
    if isinstance(default, str):
        return f'`"{default}"`'
    if default is None or default == {}:
        return "none"
    return f"`{_toml(default)}`"


def _toml(value: Any) -> str:
    """Return a number, or a tuple of numbers, as TOML."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{value:g}"


def equations() -> str:
    """Return the table of equations in the docstring of `stiction.reference_impl.paper`, as Markdown.

    The first table of the docstring, in reStructuredText, contains the equations of the paper: lines of
    equal signs are above and below the heading and at the end, and show where the columns begin.
    """
    lines = inspect.getdoc(paper).splitlines()
    top, _, bottom, *_ = [number for number, line in enumerate(lines) if line.startswith("=====")]
    starts = [match.start() for match in re.finditer("=+", lines[top])]
    ends = [*starts[1:], None]
    heading, *rows = [
        [line[start:end].strip() for start, end in zip(starts, ends)]
        for line in lines[top + 1 : bottom]
        if not line.startswith("=")
    ]
    # The second column contains functions of the module, and the last one compiled functions.
    return _table(heading, [[row[0], f"`{row[1]}`", *row[2:-1], f"`{row[-1]}`"] for row in rows])


def engine(name: str) -> str:
    """Return a section about an engine: its fidelities, friction laws and settings."""
    loaded = load_engine(name)
    fidelities = [(fidelity, law, mus) for fidelity, mus, law in fidelity_rows(loaded)]
    settings = default_settings(loaded)
    table_of_settings = ""
    if settings.rows:
        rows = [[cell and f"`{cell}`" for cell in row] for row in settings.rows]
        table_of_settings = _table(settings.heading, rows)
    return (
        f"### {name}\n\nOrder of convergence: {loaded.capabilities.order}. "
        f"Reactions are taken from the {loaded.capabilities.reactions}.\n\n"
        + _table(("fidelity", "friction law (supplied by)", "mus"), fidelities)
        + f"\n{_text(type(loaded))}\n\n{table_of_settings}"
    )


def command_line() -> str:
    """Return a section for each command of `stiction`."""
    return "\n".join(_commands(typer.main.get_command(app), "stiction"))


def _commands(command: Any, name: str) -> Iterator[str]:
    """Yield a heading, the help and a table of options for a command, or for all commands of a group.

    The commands of a group that have the same options share one table, such as those of ``compare``.
    """
    if not hasattr(command, "list_commands"):
        yield f"### {name}\n\n{command.help}\n\n{_options(command, name)}"
        return
    context = command.context_class(command, info_name=name)
    parts = {
        part: command.get_command(context, part) for part in sorted(command.list_commands(context))
    }
    tables = {_options(part, name) for part in parts.values() if not hasattr(part, "list_commands")}
    # One table of options is enough for a group whose commands have the same ones.
    if len(parts) > 1 and len(tables) == 1:
        rows = [(f"`{name} {part}`", inner.help or "") for part, inner in parts.items()]
        questions = _table(("command", "question"), rows)
        yield (
            f"### {name}\n\n{command.help}\n\n{questions}\nAll of them have these options:\n\n"
            f"{tables.pop()}"
        )
        return
    for part, inner in parts.items():
        yield from _commands(inner, f"{name} {part}")


def _options(command: Any, name: str) -> str:
    """Return a table of the arguments and options of a command; empty if it has none."""
    context = command.make_context(name, [], resilient_parsing=True)
    rows = []
    for parameter in command.params:
        if "--help" in parameter.opts:
            continue
        label = parameter.metavar or ""
        if parameter.param_type_name != "argument":
            label = f"{', '.join(parameter.opts)} {label}".strip()
        default = parameter.get_default(context)
        default_text = ""
        if parameter.required:
            default_text = "required"
        elif default not in (None, False, "", (), []):
            default_text = f"`{default}`"
        rows.append((f"`{label}`", default_text, parameter.help or ""))
    return _table(("argument or option", "default", "description"), rows) if rows else ""


def _text(documented: Any) -> str:
    """Return a docstring as Markdown: headings of NumPy sections become bold, their entries a list."""
    docstring = inspect.getdoc(documented) or ""
    lines = docstring.replace("``", "`").splitlines()
    markdown = []
    is_in_section = False
    for line, next_line in zip_longest(lines, lines[1:], fillvalue=""):
        # The heading of a section is underlined by hyphens.
        if re.fullmatch("-{3,}", next_line):
            is_in_section = True
            markdown += [f"**{line}**", ""]
        elif re.fullmatch("-{3,}", line):
            continue
        elif is_in_section and line and not line.startswith(" "):
            name, _, kind = line.partition(" : ")
            markdown.append(f"- `{name}` ({kind})" if kind else f"- `{name}`")
        else:
            markdown.append(line)
    return "\n".join(markdown)


def laws(file: str) -> str:
    """Return the part of an example solver that reads the laws of time, which ends at "mechanics"."""
    text = (SOLVERS / file).read_text(encoding="utf-8")
    _, after_heading = re.split(r"^\W*laws of time\W*$", text, maxsplit=1, flags=re.MULTILINE)
    part, *_ = re.split(r"^\W*mechanics\W*$", after_heading, flags=re.MULTILINE)
    return f"```text\n{part.strip()}\n```\n"


def new_scene() -> str:
    """Return the scene that ``stiction new`` writes."""
    return f"```toml\n{new_scene_text()}```\n"


def arithmetic() -> str:
    """Return the names of constants and functions that expressions may contain."""
    constants = ", ".join(f"`{name}`" for name in CONSTANTS)
    functions = ", ".join(f"`{name}`" for name in FUNCTIONS)
    return f"Constants: {constants}. Functions: {functions}.\n"


def columns() -> str:
    """Return a table of the columns of trajectories."""
    rows = []
    for entry in COLUMNS:
        first, *others = entry.names
        names = [f"`{entry.owner}.{first}`", *(f"`.{name}`" for name in others)]
        rows.append((" ".join(names), entry.unit, entry.meaning, entry.where))
    return _table(("column", "unit", "meaning", "present"), rows)


def submission_columns() -> str:
    """Return a table of the columns of a judged submission."""
    rows = []
    for key in SUBMISSION_COLUMNS:
        quantity = quantity_of(key)
        meaning = quantity.label
        if quantity.description:
            meaning += f": {quantity.description}"
        rows.append((f"`{key}`", quantity.unit, meaning))
    verdicts = ", ".join(f"`{verdict}`" for verdict in Verdict)
    return f"{_table(('column', 'unit', 'meaning'), rows)}\nVerdicts: {verdicts}."


def scenes() -> str:
    """Return a table of the scenes of the catalogue."""
    names = (*catalogue(), *catalogue("hard"))
    return _table(("scene", "title"), [(f"`{name}`", load_scene(name).title) for name in names])


def breakdowns() -> str:
    """Return a table of the kinds of breakdowns, each once."""
    rows = dict.fromkeys((f"`{kind}`", meaning) for kind, meaning in BREAKDOWNS.values())
    return _table(("kind", "what it means"), list(rows))


def night_history() -> str:
    """Return the description of the database with the history of nights."""
    return f"```text\n{inspect.getdoc(history)}\n```\n"


def placeholders() -> str:
    """Return a table of the placeholders in the command of a program."""
    rows = [(f"`{{{name}}}`", meaning) for name, meaning in PLACEHOLDERS.items()]
    return _table(("in an argument", "is replaced by"), rows)


GENERATED: dict[str, Callable[..., str]] = {
    "scene_format": scene_format,
    "equations": equations,
    "engine": engine,
    "laws": laws,
    "new_scene": new_scene,
    "arithmetic": arithmetic,
    "columns": columns,
    "submission_columns": submission_columns,
    "scenes": scenes,
    "breakdowns": breakdowns,
    "command_line": command_line,
    "night_history": night_history,
    "placeholders": placeholders,
}
"""The function that returns a generated part, by the name of the part."""

if __name__ == "__main__":
    write(Path(__file__).parent)
