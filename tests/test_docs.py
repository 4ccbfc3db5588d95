"""What README and docs show works, in the order in which a reader meets it; their links lead somewhere; the reference names all there is.

A page is executed in a folder of its own: a block of Python or TOML that begins with ``# name.ext`` is that file, any other block of Python is a
script, every line of a ``sh`` block is a command. Commands that take long run in `test_page_in_full` alone (mark ``long``); in every
run their options are looked up.
"""

import inspect
import json
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
import warnings
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields, is_dataclass
from importlib.util import find_spec
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import invoke

import stiction
from stiction.cli.exit_codes import NOT_COMPARED
from stiction.comparisons.bench.campaign import load_campaign
from stiction.comparisons.judge.submission import Submission
from stiction.comparisons.regression.baseline import DEFAULT
from stiction.engines import EngineMissing, engine_names, load_engine
from stiction.engines.fmu.variables import Map
from stiction.engines.program.declaration import Declaration
from stiction.engines.protocol import OBLIGATORY
from stiction.scenes import load_scene
from stiction.scenes.columns import COLUMNS

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "docs"))
import generated  # noqa: E402 - its folder is put on the path above
import pictures  # noqa: E402 - as above

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
TEXT = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PAGES}
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE_NAME = re.compile(r"# ([\w.-]+\.(?:toml|py))\n")
QUICK = {"new", "schema", "draw", "run", "judge", "dataset", "scenes", "engines", "explain"}
"""Commands of seconds."""
LEFT = {"--t-end", "--out", "--plot", "--animate", "-o"}
"""Options of a run that leaves a file, or has its own end; any other is cut short, as nobody reads where it ends."""
OF_OTHERS = {"pip", "make"}
"""Commands that set up or run what is running here already."""
YAML_COMMAND = re.compile(r"^ *-(?: run:)? (stiction [^>\n]*)", re.MULTILINE)


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


def blocks(page):
    return BLOCK.findall(TEXT[page])


def commands(text):
    return [shlex.split(line, comments=True) for line in text.splitlines() if line.strip()]


def file_in(page, name):
    """The text of a file that a page shows, which is written here."""
    text = next(text for _, text in blocks(page) if text.startswith(f"# {name}\n"))
    Path(name).write_text(text)
    return text


def follow(page, everything):
    """Do what a page says, from top to bottom; skipped at its end if an engine of its commands is not installed."""
    left_out = {}
    for language, text in blocks(page):
        if language in ("python", "toml") and (named := FILE_NAME.match(text)):
            Path(named[1]).write_text(text)
        elif language == "python":
            if everything or page != "docs/how-to/nightly.md":  # which reads the history of a night
                script(text)
        elif language == "sh":
            for command in commands(text):
                left_out |= shell(command, everything)
        else:
            assert language in ("text", "toml", "yaml")
    if left_out:
        pytest.skip(", ".join(f"{engine}: {state}" for engine, state in left_out.items()))


def script(text):
    """In a process of its own where that is the main module of children, else in this one, which has imported what takes long."""
    Path("script.py").write_text(text)
    if "__main__" in text:
        ended = subprocess.run(
            [sys.executable, "script.py"], capture_output=True, text=True, timeout=600
        )
        assert ended.returncode == 0, ended.stderr
        printed, complaints = ended.stdout, ended.stderr
    else:
        with (
            redirect_stdout(StringIO()) as out,
            redirect_stderr(StringIO()) as err,
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("error")
            runpy.run_path("script.py", run_name="__main__")
        printed, complaints = out.getvalue(), err.getvalue()
    assert complaints == "" and "failed" not in printed


def shell(command, everything):
    """Make a command, or look only whether its options exist; return its engines that are not installed, which keep it from being made."""
    if command[0] in OF_OTHERS:
        return {}
    if command[:2] == ["python", "-m"]:
        assert find_spec(command[2]) is not None
        if everything:
            subprocess.run([sys.executable, *command[1:]], check=True, timeout=600)
        return {}
    assert command[0] == "stiction", command
    is_made = everything or command[1] in QUICK
    missing = missing_engines(command) if is_made else {}
    if is_made and not missing:
        if command[1] == "run" and not everything and not LEFT & {*command}:
            command = [*command, "--t-end", "1"]
        # the first night of a campaign has nothing to be compared with, as its page says
        is_first_night = command[1] == "nightly" and "--baseline" not in command
        invoke(*command[1:], exit_code=NOT_COMPARED if is_first_night else 0)
    else:
        assert options_of(command[1:]) <= options_known(command[1:]), command
    return missing


def missing_engines(command):
    """By name of an engine that comes with the suite, or with a package, and is not installed here: its state."""
    named = [
        name
        for option, value in zip(command, command[1:])
        if option in ("--engine", "--engines")
        for name in value.split(",")
    ]
    found = {}
    for name in named:
        if name in engine_names():
            try:
                load_engine(name)
            except EngineMissing as error:
                found[name] = error.state
    return found


def options_of(command):
    return {word for word in command if word.startswith("--")}


def options_known(command):
    """By the help of a command, or of one of a group; this fails for a command that does not exist."""
    words = command[:2] if command[0] in ("compare", "baseline") else command[:1]
    return set(re.findall(r"--[a-z-]+", invoke(*words, "--help", env={"COLUMNS": "200"}).output))


@pytest.mark.parametrize("page", TEXT)
def test_page(page, compiled, in_this_process, monkeypatch):
    monkeypatch.setattr("stiction.scenes.pictures.animation.MAX_FRAMES", 5)  # frames of a film
    monkeypatch.setattr("stiction.scenes.pictures.animation.MIN_FRAMES", 5)
    follow(page, everything=False)


@pytest.mark.parametrize("state", ["not installed", "broken"])
def test_only_what_an_engine_that_is_missing_keeps_from_being_made_is_left_out(state, monkeypatch):
    """The other commands of the page are made, and a wrong option of one that is left out is found all the same."""

    def missing(name):
        error = EngineMissing("Traceback\n" * 40)
        error.state = state
        raise error

    monkeypatch.setattr(sys.modules[__name__], "load_engine", missing)
    command = "stiction run slider-bar-case-1 --engine pymunk --out x.csv".split()
    assert shell(command, everything=False) == {"pymunk": state} and not Path("x.csv").exists()
    with pytest.raises(AssertionError, match="--ot"):
        shell([*command[:-2], "--ot", "x.csv"], everything=False)
    monkeypatch.setitem(TEXT, "page", f"```sh\n{' '.join(command)}\nstiction new sled.toml\n```\n")
    with pytest.raises(pytest.skip.Exception, match=f"^pymunk: {state}$"):
        follow("page", everything=False)
    assert Path("sled.toml").is_file()


@pytest.mark.long
@pytest.mark.parametrize(
    "page", [page for page in TEXT if any(language == "sh" for language, _ in blocks(page))]
)
def test_page_in_full(page, compiled):
    follow(page, everything=True)


@pytest.mark.parametrize("page", TEXT)
def test_commands_within_the_text_exist(page):
    """Those in backticks, in blocks of text and in workflows: `stiction run SCENE --plot`."""
    found = [
        command.split("|")[0]
        for command in re.findall(
            r"`(stiction [a-z][^`]*)`", re.sub(r"\s+", " ", BLOCK.sub("", TEXT[page]))
        )
    ]
    found += [
        line
        for language, text in blocks(page)
        if language == "text"
        for line in re.findall(r"^(stiction [a-z].*)$", text, re.MULTILINE)
    ]
    found += [
        line
        for language, text in blocks(page)
        if language == "yaml"
        for line in YAML_COMMAND.findall(text)
    ]
    for command in found:
        words = shlex.split(command)[1:]
        if words and not {"SCENE", "RUN"} >= set(words[:1]):
            assert options_of(words) <= options_known(words), command


@pytest.mark.parametrize(
    "workflow", sorted((ROOT / ".github/workflows").glob("*.yml")), ids=lambda path: path.name
)
def test_commands_of_workflows_exist(workflow):
    for command in YAML_COMMAND.findall(workflow.read_text()):
        words = shlex.split(command)[1:]
        assert options_of(words) <= options_known(words)


def anchors(text):
    """Of the headings of a page, as MkDocs makes them."""
    return {
        re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())
        for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    }


@pytest.mark.parametrize("page", TEXT)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", TEXT[page]):
        if target.startswith("https://"):
            continue
        path, _, anchor = target.partition("#")
        there = (ROOT / page).parent / path if path else ROOT / page
        assert there.is_file(), target
        name = there.resolve().relative_to(ROOT).as_posix()
        assert not anchor or anchor in anchors(TEXT[name]), target


def test_pictures_of_pages_are_those_that_are_drawn():
    """Each picture in the folder has its function, and each is on a page."""
    shown = {
        Path(target).name
        for text in TEXT.values()
        for target in re.findall(r"!\[[^\]]+\]\(([^)\s]+)\)", text)
        if "pictures/" in target
    }
    drawn = {f"{name}.png" for name in pictures.PICTURES}
    assert shown == drawn == {path.name for path in pictures.FOLDER.iterdir()}


def test_every_page_is_in_the_navigation():
    listed = set(re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text()))
    assert {f"docs/{name}" for name in listed} == {
        page for page in TEXT if page.startswith("docs/")
    }


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the built site; a warning of the build is an error."""
    for package in ("mkdocs", "material", "mkdocstrings_handlers.python"):
        pytest.importorskip(package, reason="the extra docs is not installed")
    folder = tmp_path_factory.mktemp("site")
    build = ["build", "--strict", "--config-file", str(ROOT / "mkdocs.yml")]
    ended = subprocess.run(
        [sys.executable, "-m", "mkdocs", *build, "--site-dir", str(folder)],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert ended.returncode == 0, ended.stderr
    return folder


def test_site_is_built_without_a_warning_and_needs_no_network(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > len(TEXT) - 3
    for page in pages:
        text = page.read_text(encoding="utf-8")
        loaded = r"""<(?:script|link|img|iframe|source)[^>]+(?:src|href)=["']?(?:https?:)?//"""
        assert not re.findall(loaded, text), page
        assert "unpkg.com" not in text, page  # scripts that a theme loads later
    for sheet in site.rglob("*.css"):
        assert not re.findall(r"""url\(["']?(?:https?:)?//""", sheet.read_text(encoding="utf-8"))


def test_site_has_a_heading_for_every_public_name(site):
    reference = (site / "reference" / "python.html").read_text(encoding="utf-8")
    assert {*re.findall(r'id="(stiction\.\w+)"', reference)} == {
        f"stiction.{name}" for name in stiction.__all__
    }


def test_site_is_searched_from_a_folder(site, browser):
    """In a browser, without a server; nothing but files is asked for."""
    page = browser.new_page()
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((site / "engines" / "siconos.html").as_uri())
    page.locator("input[data-md-component=search-query]").click()
    page.keyboard.type("MoreauJeanOSI")  # the page searches at each key
    result = page.locator("a.md-search-result__link").first
    result.wait_for(timeout=60_000)
    assert "siconos.html" in result.get_attribute("href")
    assert asked and all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    page.close()


@pytest.mark.parametrize("page", [page for page in TEXT if page.startswith("docs/")])
def test_what_follows_from_the_code_is_current(page):
    """If not: python docs/generated.py."""
    assert generated.regenerated(TEXT[page]) == TEXT[page]
    assert (
        TEXT[page].count("<!-- generated: ") == len(generated.PART.findall(TEXT[page]))
        and "\n{{" not in TEXT[page]
    )


def test_generated_parts_are_written(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Above\n<!-- generated: arithmetic -->\nold\n<!-- end -->\n\nbelow\n")
    generated.write(tmp_path)
    above, found, below = page.read_text().partition(generated.GENERATED["arithmetic"]())
    assert (
        found
        and "old" not in above + below
        and above.startswith("# Above\n")
        and below.endswith("below\n")
    )


def test_part_of_an_engine_that_is_not_installed_stays(monkeypatch):
    def missing(name):
        raise EngineMissing(name)

    monkeypatch.setattr(generated, "load_engine", missing)
    assert (
        generated.regenerated(TEXT["docs/reference/engines.md"])
        == TEXT["docs/reference/engines.md"]
    )


class TestReference:
    def test_every_column(self):
        named = {name for column in COLUMNS for name in column.names}
        assert all(name in TEXT["docs/reference/columns.md"] for name in named)
        # the paper's mechanism has all columns but those of a drive with a limit
        runs = [
            load_engine("reference").simulate(load_scene(name), t_end=0.1)
            for name in ("slider-bar-case-1", "winch")
        ]
        assert {name.rpartition(".")[2] for run in runs for name in run.columns} == named

    def test_every_public_name_is_on_its_page_once(self):
        named = re.findall(r"^::: stiction\.(\w+)$", TEXT["docs/reference/python.md"], re.MULTILINE)
        assert sorted(named) == sorted(stiction.__all__)

    @pytest.mark.parametrize("name", stiction.__all__)
    def test_public_name_is_described_with_its_parameters(self, name):
        """Those of a function below Parameters, the fields of a dataclass below Attributes."""
        thing = getattr(stiction, name)
        assert inspect.getdoc(thing)
        if inspect.isfunction(thing):
            assert described(thing, "Parameters") == {*inspect.signature(thing).parameters}
        elif is_dataclass(thing):
            assert described(thing, "Attributes") == {field.name for field in fields(thing)}


def described(thing, section):
    """Names in a section of a docstring of NumPy's style."""
    found = re.search(
        rf"^{section}\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", inspect.getdoc(thing), re.DOTALL | re.MULTILINE
    )
    entries = re.findall(r"^(\S[^:\n]*)", found[1], re.MULTILINE) if found else []
    return {name.strip("* ") for entry in entries for name in entry.split(",")}


@pytest.mark.parametrize(
    ("page", "first", "model"),
    [
        ("program", 'name = "mine"', Declaration),
        ("fmu", "scene = ", Map),
        ("benchmark", "benchmark = ", Submission),
    ],
)
def test_declarations_show_every_key_and_no_other(page, first, model):
    [text] = [
        text
        for language, text in blocks(f"docs/how-to/{page}.md")
        if language == "toml" and text.startswith(first)
    ]
    assert model.model_validate(tomllib.loads(text)).model_fields_set == set(model.model_fields)


def test_engine(tmp_path, in_this_process):
    """The engine of the page is exact, refuses what it cannot do, and knows no setting."""
    page = "docs/how-to/engine.md"
    for name in ("free_flight.py", "ball.toml"):
        file_in(page, name)
    engine = "free_flight:FreeFlight"
    invoke("run", "ball.toml", "--engine", engine, "--out", "ball.csv")
    frame = pd.read_csv("ball.csv")
    t = frame["t"]
    assert np.allclose(frame["ball.y"], 4 * t - 9.81 * t**2 / 2) and np.allclose(
        frame["ball.angle"], 5 * t
    )
    assert "knows bodies and gravity only" in load_engine(engine).refusal(
        load_scene("pendulum"), "joint"
    )
    invoke("run", "ball.toml", "--engine", engine, "--setting", "spin=2", exit_code=2)


def test_the_page_on_engines_lists_what_is_obligatory():
    rows = re.findall(
        r"^\| `(\w+)[^|]*\|",
        (ROOT / "docs/how-to/engine.md")
        .read_text()
        .partition("| obligatory |")[2]
        .partition("\n\n")[0],
        re.MULTILINE,
    )
    assert sorted(rows) == sorted(OBLIGATORY)


def test_engine_is_held_to_its_baseline(tmp_path, in_this_process, monkeypatch):
    monkeypatch.setattr(
        "stiction.comparisons.regression.measurement.relative_time",
        lambda call, repeats: (1.0, None),
    )  # no test hangs on a time
    page = "docs/how-to/engine.md"
    for name in ("free_flight.py", "ball.toml"):
        file_in(page, name)
    held = [
        command[1:]
        for language, text in blocks(page)
        if language == "sh"
        for command in commands(text)
        if "--scenes" in command
    ]
    assert [command[0] for command in held] == ["baseline", "check", "nightly"]
    for command in held:
        ended = invoke(*command)
        assert command[0] == "baseline" or "Nothing changed beyond noise" in ended.output


def test_test_of_a_solver(compiled):
    for name in ("free_flight.py", "ball.toml", "test_free_flight.py"):
        file_in("docs/how-to/engine.md", name)
    with redirect_stdout(StringIO()) as said:
        assert (
            pytest.main(["-q", "-p", "no:cacheprovider", "-n", "0", "test_free_flight.py"]) == 0
        ), said.getvalue()
    assert " passed" in said.getvalue() and "failed" not in said.getvalue()


def test_motion_that_the_tutorial_tells(compiled):
    """Its times are those of the run, and what it says of later periods is so."""
    told = [
        float(number)
        for number in re.findall(
            r"(?:At|at) ([\d.]+) s",
            TEXT["docs/tutorial.md"].partition("## Run it")[2].partition("## See it")[0],
        )
    ]
    events = [
        event
        for event in load_engine("reference")
        .simulate(load_scene("slider-bar-case-1"), t_end=48, rtol=1e-10)
        .events
        if event.kind != "corner"
    ]
    assert [event.kind for event in events[:6]] == ["slip", *["reversal"] * 3, "stick", "slip"]
    assert [round(events[i].time, digits) for i, digits in ((0, 4), (4, 3), (5, 3))] == told
    away = np.diff(np.diff([event.time for event in events if event.kind == "stick"]) - 8)
    assert np.allclose(away[1:] / away[:-1], -1 / 3, atol=0.03)


def test_solver(in_this_process):
    file_in("docs/how-to/lcp-solver.md", "gauss_seidel.py")
    invoke("replay", "--solver", "gauss_seidel:solve", "--out", "table.csv")
    table = pd.read_csv("table.csv")
    assert table["solved"].sum() > 50 and table["wrong"].sum() > 0  # it converges on some only


class TestCampaign:
    PAGE = "docs/how-to/nightly.md"

    @pytest.fixture(autouse=True)
    def files(self, in_empty_folder):
        for name in ("sled.toml", "campaign.toml"):
            file_in(self.PAGE, name)

    def test_runs(self):
        campaign = load_campaign("campaign.toml")
        assert len(campaign.runs) == 10 and [run.key for run in campaign.check_runs][1:] == [
            "slider-bar-case-1/tight/rtol=1e-06",
            "slider-bar-case-1/tight/rtol=1e-09",
            "slider-bar-case-1/pymunk/dt=0.01",
        ]

    @pytest.mark.parametrize(
        ("old", "other", "new"),
        [
            ("", "", set()),
            ('engine = "pymunk"', 'engine = "exudyn"', {"pymunk"}),
            ("tight", "reference", {"reference"}),
        ],
        ids=["as it is", "pymunk is exudyn", "reference is Baumgarte"],
    )
    def test_it_is_no_regression_of_the_suite(self, old, other, new, tmp_path, in_this_process):
        """Its variant `pymunk` has the name of one of the suite's baseline, but is that one's `pymunk, contact`; `tight` is its `reference`."""
        text = (
            file_in(self.PAGE, "campaign.toml").replace(old, other)
            if old
            else file_in(self.PAGE, "campaign.toml")
        )
        text = text.replace('"projection"', '"baumgarte"') if other == "reference" else text
        (tmp_path / "campaign.toml").write_text(text.replace('"time"]', "]"))
        ended = invoke("nightly", "campaign.toml", "--baseline", str(DEFAULT))
        assert "**fine" in ended.output, ended.output
        [summary] = tmp_path.glob("nightly/*/summary.json")
        findings = json.loads(summary.read_text())["findings"]
        on_the_slider_bar = {
            finding["key"].split("/")[1]
            for finding in findings
            if finding["kind"] == "status" and finding["key"].startswith("slider-bar")
        }
        assert on_the_slider_bar == new
