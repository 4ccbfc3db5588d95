"""The site of results: all links resolve, numbers are those of the history, and it can be used in a browser by keyboard."""

import html
import json
import re
import sqlite3
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pandas as pd
import pytest
from conftest import content, invoke

from stiction.comparisons.bench.planned_runs import Metric, Row
from stiction.comparisons.bench.presentation import Column, TableView
from stiction.comparisons.judge.benchmark import benchmark_scenes
from stiction.comparisons.regression import history
from stiction.comparisons.studies import studies
from stiction.reports.run_folder.stored_run import read_run
from stiction.reports.site import write_site
from stiction.reports.site.content import SubmissionContent
from stiction.reports.text import Section

NIGHTS = [f"2026-03-{day:02d}T02:17:00.000Z" for day in (1, 2, 3)]
UNFINISHED = "2026-03-04T02:17:00.000Z"
CASES = ("slider-bar-case-1", "slider-bar-case-2")
ERRORS = {"reference": 1e-9, "toy": 2e-3, "toy, contact": 5e-3}
"""Position error of each variant in the first night, m."""
VERSIONS = {"reference": ("1", "1", "1"), "toy": ("7.0", "7.3", "7.3")}
VOID = {"meta", "link", "img", "br", "input", "hr"}


def run(scene: str, variant: str, night: int) -> Row:
    """The toy's errors become ten times larger in the second night; its contact crashes in the third."""
    engine = variant.partition(",")[0]
    fidelity = "contact" if "contact" in variant else "joint"
    factor = 10.0 if engine == "toy" and night > 0 else 1.0
    is_lost = fidelity == "contact" and night == 2
    metrics = (
        Metric("position_error", "accuracy", factor * ERRORS[variant], 1e-12, "closed form"),
        Metric("events_missed", "event", 2.0 * night, tier="closed form"),
        Metric("relative_time", "time", 0.5 + night, 0.01),
    )
    return Row(
        f"{scene}/{variant}/dt=0.01",
        f"{variant}; scene {scene}",
        scene,
        variant,
        engine,
        None if is_lost else VERSIONS[engine][night],
        fidelity,
        "dt",
        0.01,
        "crashed" if is_lost else "ok",
        "<script>alert('SIGSEGV')</script>" if is_lost else "",
        None if is_lost else {"iterations": 50, "friction_supplied_by": "engine"},
        () if is_lost else metrics,
    )


@pytest.fixture(scope="module")
def nights(tmp_path_factory):
    """A history of three finished nights and one that is not; there is a report of the newest finished night."""
    folder = tmp_path_factory.mktemp("nights")
    with (
        pytest.MonkeyPatch.context() as patch,
        history.open_history(folder / "history.sqlite") as opened,
    ):
        for number, night in enumerate([*NIGHTS, UNFINISHED]):
            patch.setattr(history, "_now", lambda night=night: night)
            origin = {
                "conditions": "processor",
                "commit": f"{number}" * 40,
                "versions": {"stiction": "0.1.0"},
            }
            opened.begin("nightly", f"digest {number}", origin)
            if night == UNFINISHED:
                continue
            for scene in CASES:
                for variant in ERRORS:
                    opened.append(night, run(scene, variant, number))
            opened.finish(night, "fine")
    newest = folder / NIGHTS[-1].replace(":", "")
    newest.mkdir()
    (newest / "report.md").write_text("# Night\n")
    (newest / "summary.json").write_text(json.dumps({"findings": [], "lines": ["**fine**"]}))
    return folder / "history.sqlite"


@pytest.fixture(scope="module")
def extras(tmp_path_factory):
    """A folder with the documentation, and one with a data set, as small as they can be."""
    folder = tmp_path_factory.mktemp("extras")
    for path in ("docs/index.html", "docs/engines/reference.html"):
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text("<!DOCTYPE html><title>docs</title><h1>docs</h1>")
    (folder / "truths").mkdir()
    (folder / "truths" / "README.md").write_text("# Truths\n")
    return folder


@pytest.fixture(scope="module")
def site(nights, extras, report_folder, tmp_path_factory):
    folder = tmp_path_factory.mktemp("site") / "public"
    arguments = ("--run", report_folder, "--docs", extras / "docs", "--dataset", extras / "truths")
    result = invoke("site", nights, "--out", folder, *arguments)
    assert result.stdout.strip().endswith("index.html")
    return folder


class Page(HTMLParser):
    """The identifiers, links, headings, landmarks and tables of a page."""

    def __init__(self, file: Path):
        super().__init__()
        self.ids, self.links, self.sources, self.headings, self.tags = [], [], [], [], []
        self.tables: list[list[tuple[str, list[str]]]] = []
        self.cell: list[str] | None = None
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        named = dict(attributes)
        self.tags.append((tag, named))
        if "id" in named:
            self.ids.append(named["id"])
        if "href" in named and tag != "link":
            self.links.append(named["href"])
        self.sources += [named[name] for name in ("src", "srcset", "data") if named.get(name)]
        if tag == "link":
            self.sources.append(named["href"])
        if tag in ("h1", "h2", "h3"):
            self.headings.append(int(tag[1]))
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append((named.get("id", ""), []))
        if tag in ("td", "th"):
            self.cell = []

    def handle_data(self, data):
        if self.cell is not None:
            self.cell.append(data)

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.tables[-1][-1][1].append("".join(self.cell))
            self.cell = None


@pytest.fixture(scope="module")
def pages(site) -> dict[str, Page]:
    files = sorted(site.rglob("*.html"))
    return {file.relative_to(site).as_posix(): Page(file) for file in files}


def test_there_is_a_page_for_each_question_and_engine(pages, report_folder):
    named = {study.name for study in studies()}
    questions = {path for path in pages if path.startswith("questions/")}
    assert {path[len("questions/") : -len(".html")] for path in questions} <= named
    assert {"questions/accuracy.html", "questions/cost.html", "questions/torque.html"} <= questions
    engines = {path for path in pages if path.startswith("engines/")}
    assert engines == {"engines/reference.html", "engines/toy.html"}
    assert {"index.html", "nights/index.html", "run/index.html", "docs/index.html"} <= set(pages)


def test_every_link_leads_to_a_file_and_a_place_in_it(site, pages):
    followed = 0
    for path, page in pages.items():
        assert len(page.ids) == len(set(page.ids)), path
        for link in page.links:
            address = urlsplit(link)
            assert not address.scheme and not address.netloc, (path, link)
            target = (site / path).parent / unquote(address.path) if address.path else site / path
            target = target.resolve()
            assert target.is_file() and target.is_relative_to(site.resolve()), (path, link)
            if address.fragment:
                found = pages[target.relative_to(site.resolve()).as_posix()]
                assert unquote(address.fragment) in found.ids, (path, link)
            followed += 1
    assert followed > 200


def test_every_page_can_be_reached_from_the_front_page(site, pages):
    reached, waiting = set(), ["index.html"]
    while waiting:
        path = waiting.pop()
        if path in reached:
            continue
        reached.add(path)
        for link in pages[path].links:
            file = ((site / path).parent / unquote(urlsplit(link).path)).resolve()
            if file.suffix == ".html":
                waiting.append(file.relative_to(site.resolve()).as_posix())
    assert reached == set(pages)


def test_nothing_is_loaded_from_elsewhere(pages):
    for path, page in pages.items():
        assert all(source.startswith("data:") for source in page.sources), path


def test_what_a_run_has_printed_is_no_markup(site):
    text = (site / "engines" / "toy.html").read_text()
    assert "&lt;script&gt;alert" in text and "<script>alert" not in text


def rows_of(page: Page, prefix: str = "night-") -> dict[str, tuple[list[str], list[str]]]:
    """By the key of a run, the heading and the cells of its row in the tables of a night."""
    found = {}
    for (_, heads), *rows in page.tables:
        for identifier, cells in rows:
            if identifier.startswith(prefix):
                found[cells[-1]] = (heads, cells)
    return found


def test_numbers_are_those_of_the_history(nights, pages):
    stored = pd.read_sql("SELECT * FROM history", sqlite3.connect(nights))
    newest = stored[stored["night"] == NIGHTS[-1]]
    rows = rows_of(pages["questions/accuracy.html"])
    assert set(rows) == set(newest["key"])
    for key, (heads, cells) in rows.items():
        part = newest[newest["key"] == key].set_index("metric")
        shown = dict(zip(heads, cells, strict=True))
        for metric, head in (
            ("position_error", "position error [m]"),
            ("events_missed", "events missed"),
        ):
            if metric in part.index:
                assert float(shown[head]) == pytest.approx(part.loc[metric, "value"], rel=0.05)
                assert shown["engine"] == f"{part['engine'].iloc[0]} {part['version'].iloc[0]}"
            else:
                assert shown[head] == "–" and shown["end of the run"].startswith("crashed: ")
    rows = rows_of(pages["questions/cost.html"])
    for key, (heads, cells) in rows.items():
        part = newest[(newest["key"] == key) & (newest["metric"] == "relative_time")]
        shown = dict(zip(heads, cells, strict=True))
        [value] = [text for head, text in shown.items() if head.startswith("least CPU time")]
        if not part.empty:
            assert float(value.partition(" ±")[0]) == pytest.approx(part["value"].iloc[0], rel=0.05)


def test_fidelities_are_kept_apart_and_in_the_order_of_the_campaign(pages):
    table = pages["questions/accuracy.html"].tables
    [cells] = [
        [row[0] for _, row in rows[1:]]
        for rows in table
        if any(f"{CASES[0]}/toy/dt=0.01" in row for _, row in rows)
    ]
    assert cells == ["joints", "reference", "toy", "contacts", "toy, contact"]


def test_an_engine_page_tells_versions_and_what_changed_when(site, pages):
    text = (site / "engines" / "toy.html").read_text()
    assert "Night of 2026-03-02 02:17 UTC: version 7.0 -&gt; 7.3; " in text
    assert text.count("-&gt; 7.3; ") == 1
    assert " -&gt; " not in (site / "engines" / "reference.html").read_text()
    tables = pages["engines/toy.html"].tables
    [versions] = [rows for rows in tables if "version of the engine" in rows[0][1]]
    assert [cells[:2] for _, cells in versions[1:]] == [
        [NIGHTS[2], "7.3"],
        [NIGHTS[1], "7.3"],
        [NIGHTS[0], "7.0"],
    ]
    [changes] = [rows for rows in tables if "run that changed most" in rows[0][1]]
    found = {(cells[0], cells[1], cells[4], cells[5]) for _, cells in changes[1:]}
    # Both variants became worse in the second night; in the third, contact crashed and joint missed more events.
    assert (NIGHTS[1], "position error [m]", "regression", "2") in found
    assert (NIGHTS[2], "end of the run", "regression", "2") in found
    assert not [
        night for night, number, _, _ in found if night == NIGHTS[2] and "position" in number
    ]
    reference = pages["engines/reference.html"].tables
    changes = [rows for rows in reference if "run that changed most" in rows[0][1]]
    assert {cells[1] for _, cells in changes[0][1:]} == {"events missed"}


def test_the_front_page_has_the_answer_and_its_numbers_lead_to_their_rows(
    site, pages, report_folder
):
    page = pages["index.html"]
    keyed = [link for link in page.links if "#row-" in link]
    assert keyed and all(link.startswith("questions/") for link in keyed)
    origin = read_run(report_folder).origin
    assert origin["date"][:10] in (site / "index.html").read_text()
    titles = [named["title"] for tag, named in page.tags if tag == "a" and "#row-" in named["href"]]
    version = origin["versions"]["stiction"]
    assert all(
        f"stiction {version}" in title and "commit" in title and ":" in title for title in titles
    )


def test_a_key_has_the_version_of_the_engine_and_the_command_that_repeats_its_runs(
    site, report_folder
):
    """The commands are those of the data; trajectories are not part of the download, and this is said."""
    run = read_run(report_folder)
    text = (site / "questions" / "accuracy.html").read_text()
    paragraphs = re.findall(r'<p id="key-[^"]*"><strong>accuracy:\d+</strong>.*?</p>', text, re.S)
    commands = set(run.tables["accuracy"]["rerun_command"].dropna())
    repeated = 0
    version = run.origin["engines"]["reference"]
    assert any(f"engine reference {version}" in paragraph for paragraph in paragraphs)
    for paragraph in paragraphs:
        shown = re.findall("<code>(.*?)</code>", paragraph)
        repeated += bool(shown)
        # A method whose runs all failed has no command of its own.
        campaign = {run.origin["command"]}
        assert {html.unescape(command) for command in shown} <= commands | campaign
        assert "trajectories/" not in paragraph or "not part of the download" in paragraph
    assert commands and repeated == len(paragraphs)


def test_downloads_are_named_as_their_links(pages):
    page = pages["index.html"]
    files = [link for link in page.links if link.startswith(("download/", "nights/history"))]
    text = [Path(link).name for link in files]
    assert sorted(text) == ["dataset.zip", "history.sqlite", "run.zip"]


def test_terms_of_the_table_lead_to_the_glossary(pages):
    page = pages["index.html"]
    terms = {"mu", "mus", "joint", "contact", "adapter", "truth", "reference", "creep", "drift"}
    assert {f"term-{term}" for term in terms | {"tier"}} <= set(page.ids)
    assert {"#term-adapter", "#term-joint"} <= set(page.links)


def test_several_runs_are_shown_side_by_side(nights, report_folder, tmp_path):
    run = read_run(report_folder)
    later = type(run)(run.folder, {**run.origin, "date": "2099-01-01T00:00:00+00:00"}, run.tables)
    write_site(nights, tmp_path / "public", [later, run])
    page = Page(tmp_path / "public" / "questions" / "accuracy.html")
    tables = [rows for rows in page.tables if "2099-01-01 00:00 UTC" in rows[0][1]]
    assert tables and all(rows[0][1][-1] == "2099-01-01 00:00 UTC" for rows in tables)
    assert all(cells[1] == cells[2] for rows in tables for _, cells in rows[1:])


def test_a_submission_has_a_page(nights, tmp_path):
    """From the text and tables of its judgement, whatever judged it."""
    view = TableView(
        "scenes", pd.DataFrame({"scene": ["belt"]}), (Column("scene"),), "scenes", ((1,),)
    )
    submission = SubmissionContent(
        "submissions/mine.html",
        "mine 1.0",
        {"who": "<nobody>"},
        Section(answer="1 of 1 scenes within bounds.", tables=(view,), notes=("A note.",)),
    )
    write_site(nights, tmp_path / "public", submissions=[submission])
    front = Page(tmp_path / "public" / "index.html")
    assert {"submissions/mine.html", "#submissions"} <= set(front.links)
    page = tmp_path / "public" / submission.path
    assert "&lt;nobody&gt;" in page.read_text() and "within bounds" in page.read_text()
    assert ["belt", "scenes:1"] in [cells for rows in Page(page).tables for _, cells in rows]


def test_submissions_are_judged(nights, tmp_path):
    """A submission that declines all scenes has a verdict, too, and is judged at once."""
    for name in ("second", "first"):
        (tmp_path / "submissions" / name).mkdir(parents=True)
        lines = [
            'benchmark = "friction-benchmark 1"',
            'who = "somebody"',
            f'engine = "{name}"',
            'version = "1.0"',
            'fidelity = "joint"',
            'machine = "a slide rule"',
            'command = "none"',
            "[declined]",
            *(f'{scene.name} = "too hard"' for scene in benchmark_scenes()),
        ]
        (tmp_path / "submissions" / name / "submission.toml").write_text("\n".join(lines))
    (tmp_path / "submissions" / "notes.txt").touch()
    out = tmp_path / "public"
    invoke("site", nights, "--submissions", tmp_path / "submissions", "--out", out)
    links = [link for link in Page(out / "index.html").links if link.startswith("submissions/")]
    assert links == ["submissions/first.html", "submissions/second.html"]
    rows = [cells for rows in Page(out / links[0]).tables for _, cells in rows]
    assert ["machine", "a slide rule"] in rows
    text = (out / links[0]).read_text()
    assert f"{len(benchmark_scenes())} declined: too hard (" in text
    assert all(scene.name in text for scene in benchmark_scenes())
    assert "no scene was judged" in text
    (tmp_path / "empty").mkdir()
    result = invoke("site", nights, "--submissions", tmp_path / "empty", "--out", out, exit_code=2)
    assert "found no submission" in " ".join(result.output.split())


def test_without_a_run_the_front_page_says_so(nights, tmp_path):
    write_site(nights, tmp_path / "public")
    front = (tmp_path / "public" / "index.html").read_text()
    assert "built without a run" in front and not (tmp_path / "public" / "run").exists()
    page = Page(tmp_path / "public" / "questions" / "accuracy.html")
    assert len(rows_of(page)) == len(CASES) * len(ERRORS)


def test_the_same_input_gives_the_same_bytes_and_an_earlier_site_is_replaced(
    nights, extras, report_folder, site, tmp_path
):
    out = tmp_path / "public"
    arguments = ("--run", report_folder, "--docs", extras / "docs", "--dataset", extras / "truths")
    for _ in range(2):
        invoke("site", nights, "--out", out, *arguments)
        assert content(out) == content(site)


def test_the_history_can_be_downloaded(site, nights):
    copies = [
        pd.read_sql("SELECT * FROM history", sqlite3.connect(file))
        for file in (site / "nights" / "history.sqlite", nights)
    ]
    pd.testing.assert_frame_equal(*copies)


@pytest.mark.parametrize("path", ["index.html", "questions/accuracy.html", "engines/toy.html"])
def test_pages_have_landmarks_headings_and_named_tables(pages, path):
    page = pages[path]
    tags = [tag for tag, _ in page.tags]
    assert all(tags.count(tag) == 1 for tag in ("main", "header", "footer", "h1"))
    assert all(named.get("aria-label") for tag, named in page.tags if tag == "nav")
    assert page.headings[0] == 1
    assert all(low - high <= 1 for high, low in zip(page.headings, page.headings[1:]))
    first_link = next(named for tag, named in page.tags if tag == "a")
    assert first_link["href"] == "#page-content" and "page-content" in page.ids
    assert tags.count("caption") == tags.count("table") == len(page.tables)
    assert all(named.get("scope") for tag, named in page.tags if tag == "th")
    boxes = [named for tag, named in page.tags if tag == "div" and named.get("class") == "table"]
    assert all(box["tabindex"] == "0" and box["aria-label"] for box in boxes)
    assert ("html", {"lang": "en"}) in page.tags


def history_without_a_finished_night(folder: Path) -> Path:
    with history.open_history(folder / "history.sqlite") as opened:
        opened.begin("c", "digest", {"conditions": "processor", "commit": None})
    return folder / "history.sqlite"


def test_bad_input_names_the_file_and_what_was_expected(nights, tmp_path):
    text = tmp_path / "notes.txt"
    text.write_text("no history")
    empty = tmp_path / "empty"
    empty.mkdir()
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "thesis.tex").touch()
    unfinished = history_without_a_finished_night(tmp_path)
    out = ("--out", tmp_path / "public")
    for arguments, named, expected in [
        ((tmp_path / "absent.sqlite", *out), "absent.sqlite", "expected a history"),
        ((empty, *out), "empty", "expected a history"),
        ((text, *out), "notes.txt", "expected a history"),
        ((unfinished, *out), "history.sqlite", "at least one finished night"),
        ((nights, "--out", foreign), "foreign", "expected an empty folder"),
        ((nights, *out, "--run", empty), "empty", "expected a run folder"),
        ((nights, *out, "--docs", empty), "empty", "expected the folder `site`"),
        ((nights, *out, "--dataset", empty), "empty", "expected a folder written by"),
    ]:
        # Messages are broken into lines, within paths too.
        message = "".join(invoke("site", *arguments, exit_code=2).output.split())
        assert named in message and "".join(expected.split()) in message, message
    assert not (tmp_path / "public").exists()


@pytest.fixture
def open_page(watched_page, site):
    """A function that opens a page of the site by its path in it; see `watched_page`."""
    return lambda path, **options: watched_page(f"{site.as_uri()}/{path}", site.as_uri(), **options)


PATHS = ("index.html", "questions/accuracy.html", "engines/toy.html", "nights/index.html")


@pytest.mark.parametrize("path", PATHS)
def test_a_narrow_screen_needs_no_scrolling_sideways(path, open_page):
    page = open_page(path, width=390, height=844)
    page.evaluate(
        "() => document.querySelectorAll('details').forEach(part => { part.open = true; })"
    )
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    clipped = page.evaluate("""() => [...document.querySelectorAll("h1, h2, h3, p, li, summary, .controls, footer")]
        .filter(element => element.getBoundingClientRect().right > innerWidth + 1).length""")
    assert clipped == 0


def test_a_table_that_is_wider_than_the_screen_says_so_and_keeps_its_heads(open_page):
    """On a narrow screen only: a hint above the columns; the heads stay while the rows are scrolled."""
    page = open_page("index.html", width=390, height=844)
    box = page.locator(".table.wide").first
    box.wait_for()
    hint = box.evaluate("box => getComputedStyle(box, '::before').content")
    assert "sideways" in hint
    assert box.locator("thead th").first.evaluate("head => getComputedStyle(head).position") == (
        "sticky"
    )
    navigation = page.locator("nav.site")
    assert navigation.evaluate("nav => nav.scrollWidth <= nav.clientWidth")


def focused(page) -> dict:
    """What has the focus: its text, address and outline."""
    return page.evaluate("""() => {
        const element = document.activeElement, style = getComputedStyle(element);
        return {text: element.innerText ?? "", href: element.getAttribute("href") ?? "",
                outline: style.outlineStyle === "none" ? 0 : parseFloat(style.outlineWidth)};
    }""")


def test_the_site_is_used_by_keyboard_alone(open_page, site):
    """From the front page to a question, past the navigation; each element shows that it has the focus."""
    page = open_page("index.html")
    page.keyboard.press("Tab")
    assert focused(page)["text"] == "Skip to the content"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "page-content"
    for _ in range(500):
        page.keyboard.press("Tab")
        now = focused(page)
        assert now["outline"] >= 2, now
        if now["href"] == "questions/accuracy.html" and now["text"].endswith("?"):
            break
    page.keyboard.press("Enter")
    page.wait_for_url("**/questions/accuracy.html")
    page.wait_for_selector("body[data-ready=yes]", timeout=600_000)
    # The second scene is opened by its summary.
    summary = page.locator("summary", has_text=CASES[1]).first
    summary.focus()
    page.keyboard.press("Enter")
    assert summary.evaluate("summary => summary.parentElement.open")


def test_a_link_to_a_row_opens_the_part_that_contains_it(open_page, pages):
    [link] = {
        link
        for link in pages["engines/toy.html"].links
        if "accuracy.html#night" in link and CASES[1] in link and "contact" not in link
    }
    page = open_page(f"engines/{link}")
    row = page.locator(f"[id='{urlsplit(link).fragment}']")
    assert row.is_visible() and f"{CASES[1]}/toy/dt=0.01" in row.inner_text()


def test_dark_and_light_follow_the_system(open_page):
    colors = {
        scheme: open_page("index.html", scheme=scheme).evaluate(
            "getComputedStyle(document.body).backgroundColor"
        )
        for scheme in ("light", "dark")
    }
    assert colors == {"light": "rgb(255, 255, 255)", "dark": "rgb(22, 22, 22)"}
