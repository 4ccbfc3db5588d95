"""Parts of the pages that follow from the code; tests hold them to it. ``python docs/generated.py`` writes them anew.

A part stands in a page between ``<!-- generated: NAME -->``, a name of `GENERATED` with its argument, and
``<!-- end -->``.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from stiction.cli.app import app
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
from stiction.scenes.model import Scene

PART = re.compile(
    r"^(<!-- generated: ([\w. -]+) -->\n).*?(^<!-- end -->$)", re.MULTILINE | re.DOTALL
)


def regenerated(page: str) -> str:
    """The text of a page with its parts as the code has them; the part of an engine that is not installed stays."""

    def part(found: re.Match[str]) -> str:
        name, *arguments = found[2].split()
        try:
            return f"{found[1]}\n{GENERATED[name](*arguments).strip()}\n\n{found[3]}"
        except EngineMissing:
            return found[0]

    return PART.sub(part, page)


def write(folder: Path) -> None:
    """Write the parts of all pages in a folder anew."""
    for path in folder.rglob("*.md"):
        path.write_text(regenerated(path.read_text(encoding="utf-8")), encoding="utf-8")


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [
        " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line)
        for line in (columns, *rows)
    ]
    return "".join(
        f"| {line} |\n" for line in (lines[0], " | ".join(["---"] * len(columns)), *lines[1:])
    )


def scene_format() -> str:
    """A table for the top of the file and for every kind of element."""
    parts = [("Top of the file", Scene), ("`[bodies.NAME]`", *ELEMENTS["bodies"].values())]
    for section in ("joints", "drives", "springs", "forces"):
        parts += [
            (f"`[{section}.NAME]`" + (f', `type = "{tag}"`' if tag else ""), model)
            for tag, model in ELEMENTS[section].items()
        ]
    parts += [(f'`law = {{ type = "{tag}", .. }}`', model) for tag, model in LAWS.items()]
    parts += [
        (f'`[stabilization]`, `method = "{tag}"`', model) for tag, model in STABILIZATIONS.items()
    ]
    return "\n".join(
        f"### {title}\n\n{_text(model)}\n\n"
        + _table(
            ("key", "default", "description"),
            (
                (f"`{key}`", _default(field), field.description or "")
                for key, field in model.model_fields.items()
            ),
        )
        for title, model in parts
    )


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.default
    if isinstance(default, BaseModel):
        return f'`method = "{default.method}"`'
    if isinstance(default, str):
        return f'`"{default}"`' if default else "empty"
    return "none" if default is None or default == {} else f"`{_toml(default)}`"


def _toml(value: Any) -> str:
    return f"[{', '.join(map(_toml, value))}]" if isinstance(value, tuple) else f"{value:g}"


def equations() -> str:
    """The table of equations of `stiction.reference_impl.paper`, which is in reStructuredText."""
    lines = inspect.getdoc(paper).splitlines()
    rules = [i for i, line in enumerate(lines) if line.startswith("=====")]
    starts = [found.start() for found in re.finditer("=+", lines[rules[0]])]
    rows = [
        [line[start:end].strip() for start, end in zip(starts, [*starts[1:], None])]
        for line in lines[rules[0] + 1 : rules[2]]
        if not line.startswith("=")
    ]
    heading, *rows = rows
    return _table(heading, [[row[0], f"`{row[1]}`", *row[2:-1], f"`{row[-1]}`"] for row in rows])


def engine(name: str) -> str:
    """Fidelities, friction laws and settings of an engine."""
    built = load_engine(name)
    fidelities = [(fidelity, law, mus) for fidelity, mus, law in fidelity_rows(built)]
    heading, rows = default_settings(built)
    settings = (
        _table(heading, [[cell and f"`{cell}`" for cell in row] for row in rows]) if rows else ""
    )
    return (
        f"### {name}\n\nOrder of convergence: {built.capabilities.order}. "
        f"Reactions are taken from the {built.capabilities.reactions}.\n\n"
        + _table(("fidelity", "friction law (supplied by)", "mus"), fidelities)
        + f"\n{_text(type(built))}\n\n{settings}"
    )


def _commands(command: Any, name: str) -> Iterator[str]:
    """A heading, the help and a table of options for every command.

    The studies of ``compare`` have the same options: they share one table.
    """
    if not hasattr(command, "list_commands"):
        yield f"### {name}\n\n{command.help}\n\n{_options(command, name)}"
        return
    context = command.context_class(command, info_name=name)
    parts = {
        part: command.get_command(context, part) for part in sorted(command.list_commands(context))
    }
    tables = {_options(part, name) for part in parts.values() if not hasattr(part, "list_commands")}
    if len(parts) > 1 and len(tables) == 1:
        studies = _table(
            ("command", "question"),
            [(f"`{name} {study}`", part.help or "") for study, part in parts.items()],
        )
        yield f"### {name}\n\n{command.help}\n\n{studies}\nAll of them have these options:\n\n{tables.pop()}"
        return
    for part, inner in parts.items():
        yield from _commands(inner, f"{name} {part}")


def _options(command: Any, name: str) -> str:
    context = command.make_context(name, [], resilient_parsing=True)
    rows = []
    for parameter in command.params:
        if "--help" in parameter.opts:
            continue
        metavar = parameter.metavar or ""
        label = (
            metavar
            if parameter.param_type_name == "argument"
            else f"{', '.join(parameter.opts)} {metavar}".strip()
        )
        default = parameter.get_default(context)
        shown = (
            "required"
            if parameter.required
            else ""
            if default in (None, False, "", (), [])
            else f"`{default}`"
        )
        rows.append((f"`{label}`", shown, parameter.help or ""))
    return _table(("argument or option", "default", "description"), rows) if rows else ""


def _text(thing: Any) -> str:
    """A docstring as Markdown: sections of NumPy's kind become bold, their entries a list."""
    lines, found, section = (inspect.getdoc(thing) or "").replace("``", "`").splitlines(), [], False
    for i, line in enumerate(lines):
        if i + 1 < len(lines) and re.fullmatch("-{3,}", lines[i + 1]):
            section = True
            found += [f"**{line}**", ""]
        elif re.fullmatch("-{3,}", line):
            continue
        elif section and line and not line.startswith(" "):
            head, _, kind = line.partition(" : ")
            found.append(f"- `{head}`" + (f" ({kind})" if kind else ""))
        else:
            found.append(line)
    return "\n".join(found)


def laws(file: str) -> str:
    """The part of an example solver that reads the laws of time."""
    text = (Path(__file__).parent / "examples" / "solvers" / file).read_text(encoding="utf-8")
    part = re.split(
        r"^\W*mechanics\W*$",
        re.split(r"^\W*laws of time\W*$", text, flags=re.MULTILINE)[1],
        flags=re.MULTILINE,
    )[0]
    return f"```text\n{part.strip()}\n```\n"


GENERATED: dict[str, Callable[..., str]] = {
    "scene_format": scene_format,
    "equations": equations,
    "engine": engine,
    "laws": laws,
    "new_scene": lambda: f"```toml\n{new_scene_text()}```\n",
    "arithmetic": lambda: "Constants: {}. Functions: {}.\n".format(
        *(", ".join(f"`{name}`" for name in names) for names in (CONSTANTS, FUNCTIONS))
    ),
    "columns": lambda: _table(
        ("column", "unit", "meaning", "present"),
        [
            (
                f"`{entry.owner}.{entry.names[0]}`"
                + "".join(f" `.{name}`" for name in entry.names[1:]),
                entry.unit,
                entry.meaning,
                entry.where,
            )
            for entry in COLUMNS
        ],
    ),
    "scenes": lambda: _table(
        ("scene", "title"),
        [(f"`{name}`", load_scene(name).title) for name in (*catalogue(), *catalogue("hard"))],
    ),
    "breakdowns": lambda: _table(
        ("kind", "what it means"),
        dict.fromkeys((f"`{kind}`", words) for kind, words in BREAKDOWNS.values()),
    ),
    "command_line": lambda: "\n".join(_commands(typer.main.get_command(app), "stiction")),
    "night_history": lambda: f"```text\n{inspect.getdoc(history)}\n```\n",
    "placeholders": lambda: _table(
        ("in an argument", "is replaced by"),
        [(f"`{{{name}}}`", words) for name, words in PLACEHOLDERS.items()],
    ),
}
"""What a part consists of, by its name."""

if __name__ == "__main__":
    write(Path(__file__).parent)
