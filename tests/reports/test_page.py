"""The pages in a real browser: they open without errors and without a network, zoom, reset, hide and show, by day and by night."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from stiction.comparisons.campaigns import history
from stiction.comparisons.campaigns.measurement import Metric, Row
from stiction.reports.page import write_history_page, write_run_page
from stiction.reports.run_folder.stored_run import read_run
from stiction.cli.app import app

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
NIGHTS = [f"2026-03-{day:02d}T02:00:00.000Z" for day in (1, 2, 3)]
CASES = ("slider-bar-case-1", "slider-bar-case-2")


@pytest.fixture(scope="module")
def run_page(report_folder, tmp_path_factory):
    file = tmp_path_factory.mktemp("pages") / "run.html"
    write_run_page(read_run(report_folder), file)
    return file


@pytest.fixture(scope="module")
def history_file(tmp_path_factory):
    """Three nights of two runs on two scenes; one run crashes in the second night, its reason looks like HTML."""
    file = tmp_path_factory.mktemp("pages") / "history.sqlite"
    with pytest.MonkeyPatch.context() as patch, history.open_history(file) as opened:
        for number, night in enumerate(NIGHTS):
            patch.setattr(history, "_now", lambda night=night: night)
            opened.begin("nightly", "digest", {"conditions": "processor", "commit": f"abc{number}"})
            for scene in CASES:
                for variant, lost in (("reference", False), ("other", number == 1)):
                    metrics = () if lost else (Metric("position error [m]", "accuracy", 1e-3 * (number + 1), 1e-9, "closed form"),
                                               Metric("time of the run [s]", "time", 0.5, 0.01), Metric("pivots [-]", "counter", 133.0))
                    opened.append(night, Row(f"{scene}/{variant}/dt=0.01", f"{variant}; scene {scene}", scene, variant, variant, "1", "joint", "dt", 0.01,
                                             "crashed" if lost else "ok", "<script>alert('SIGSEGV')</script>" if lost else "", {}, metrics))
            opened.finish(night, "regression" if number == 2 else "fine")
    return file


@pytest.fixture(scope="module")
def history_page(history_file):
    write_history_page(history_file, file := history_file.with_suffix(".html"))
    return file


@pytest.fixture(scope="module")
def browser() -> Iterator:
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (pip install '.[test]')")
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    if executable is None:
        pytest.skip(f"no browser on this machine: none of {', '.join(BROWSERS)} is on the path")
    with api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])  # where tests run as root
        yield opened
        opened.close()


@pytest.fixture
def open_page(browser):
    """A function that opens a file without a network and fails on whatever the page complains of or asks the network for."""
    contexts, complaints = [], []

    def opened(file, scheme="light"):
        context = browser.new_context(offline=True, color_scheme=scheme, viewport={"width": 1280, "height": 900})
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text) if message.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: None if request.url.startswith((file.as_uri(), "data:", "blob:"))
                else complaints.append(f"asks for {request.url}"))
        page.goto(file.as_uri())
        page.wait_for_selector("body[data-ready=yes]", timeout=600_000)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert complaints == []


def ranges(page) -> dict[str, list]:
    """Of all axes of the first chart."""
    return page.evaluate("""() => { const layout = document.querySelector(".chart")._fullLayout;
        return Object.fromEntries(Object.keys(layout).filter(k => /^[xy]axis/.test(k)).map(k => [k, layout[k].range])); }""")


def until(found: Callable[[], object], expected: object) -> None:
    """Wait until `found` yields what is expected; the page's own rules forbid playwright to wait in it."""
    end = time.monotonic() + 600
    while found() != expected and time.monotonic() < end:
        time.sleep(0.05)
    assert found() == expected


def drag(page, panel: str = ".xy .nsewdrag", start=(0.4, 0.3), end=(0.6, 0.7)) -> None:
    box = page.locator(f".chart .draglayer {panel}").first.bounding_box()
    place = [(box["x"] + share * box["width"], box["y"] + height * box["height"]) for share, height in (start, end)]
    page.mouse.move(*place[0])
    page.mouse.down()
    page.mouse.move(*place[1], steps=5)
    page.mouse.up()
    page.wait_for_timeout(700)  # plotly's own transition, and the time in which a second click would be a double one


def visible(page) -> dict[str, set]:
    """By name, whether its lines are shown; one element where all panels agree."""
    found = page.evaluate("""() => document.querySelector(".chart")._fullData.map(trace => [trace.name, trace.visible === true])""")
    return {name: {shown for other, shown in found if other == name} for name, _ in found}


def test_zoom_changes_all_time_axes_and_reset_brings_them_back(run_page, open_page):
    page = open_page(run_page)
    page.locator(".chart").scroll_into_view_if_needed()
    before = ranges(page)
    assert before["xaxis"] == [0, 9]
    drag(page)
    until(lambda: ranges(page) != before, True)
    zoomed = ranges(page)
    time_axes = [name for name in zoomed if name.startswith("x")]
    assert len(time_axes) == 7 and all(zoomed[name] == zoomed["xaxis"] for name in time_axes)
    np.testing.assert_allclose(zoomed["xaxis"], [3.6, 5.4], atol=0.05)  # 0.4 and 0.6 of 9 s, to a pixel or two
    assert zoomed["yaxis"] != before["yaxis"] and zoomed["yaxis2"] == before["yaxis2"]
    page.get_by_role("button", name="Reset zoom").click()
    until(lambda: ranges(page), before)
    drag(page)
    until(lambda: ranges(page) != before, True)
    box = page.locator(".chart .draglayer .xy .nsewdrag").first.bounding_box()
    page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    until(lambda: ranges(page), before)


def test_a_name_hides_and_shows_its_lines_in_all_panels(run_page, open_page):
    page = open_page(run_page)
    name = "other (dt = 0.0025 s)"
    before = visible(page)
    assert before[name] == {True} and before["paper's scheme (dt = 0.0025 s)"] == {False}

    entry = page.locator(".chart .legend .traces", has_text=name).locator(".legendtoggle")
    entry.click()
    until(lambda: visible(page), {**before, name: {False}})
    page.wait_for_timeout(700)  # two clicks, not a double one
    entry.click()
    until(lambda: visible(page), before)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(scheme, run_page, open_page):
    page = open_page(run_page, scheme)
    colors = page.evaluate("""() => { const of = (element, what) => getComputedStyle(element)[what];
        const chart = document.querySelector(".chart"), body = document.body;
        return {ground: of(body, "backgroundColor"), text: of(body, "color"), quiet: of(document.querySelector("caption"), "color"),
                axis: of(chart.querySelector(".xtick text, .x7tick text"), "fill"),
                line: of(chart.querySelector(".scatterlayer .trace:last-child path.js-line"), "stroke"),
                paper: of(chart.querySelector(".main-svg"), "backgroundColor")}; }""")
    luminance = {name: _luminance(color) for name, color in colors.items()}
    assert (luminance["ground"] < 0.05) == (scheme == "dark") and colors["paper"] == colors["ground"]
    for name in ("text", "quiet", "axis", "line"):
        light, dark = sorted((luminance[name], luminance["ground"]), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5, name  # WCAG 2.1, AA


def _luminance(color: str) -> float:
    """Relative luminance of WCAG 2.1 of ``rgb(r, g, b)``."""
    parts = [int(part) / 255 for part in re.findall(r"\d+", color)[:3]]
    linear = [part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return float(np.dot((0.2126, 0.7152, 0.0722), linear))


def test_tables_and_figures_are_in_the_page(run_page, report_folder, open_page):
    page = open_page(run_page)
    run = read_run(report_folder)
    assert page.locator("h2").all_inner_texts()[:3] == ["Results", "Time series", "Accuracy"]
    rows = page.locator('td[id^="accuracy-"]')
    assert rows.all_inner_texts() == [f"A{row}" for row in range(1, len(run.tables["accuracy"]) + 1)]
    assert "data/trajectories/" in rows.first.get_attribute("title")
    widths = page.evaluate("() => [...document.images].map(image => image.naturalWidth)")
    assert len(widths) >= 4 and all(width > 1000 for width in widths)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")  # wide tables scroll on their own


def test_history_draws_each_metric_s_course(history_page, open_page):
    page = open_page(history_page)
    metric, scene = page.locator(".controls select").all()
    assert metric.locator("option").all_inner_texts() == ["position error [m]", "time of the run [s]", "pivots [-]"]
    assert scene.locator("option").all_inner_texts() == list(CASES)

    def lines() -> dict[str, list]:
        return dict(page.evaluate("() => document.querySelector('.chart')._fullData.map(trace => [trace.name, Array.from(trace.y)])"))

    assert lines() == {"reference (dt = 0.01 s)": [1e-3, 2e-3, 3e-3], "other (dt = 0.01 s)": [1e-3, None, 3e-3]}
    before = ranges(page)
    drag(page)
    until(lambda: ranges(page) != before, True)
    metric.select_option("pivots [-]")
    scene.select_option(CASES[1])
    until(lines, {"reference (dt = 0.01 s)": [133, 133, 133], "other (dt = 0.01 s)": [133, None, 133]})
    assert "<script>alert('SIGSEGV')</script>" in page.locator("table").last.inner_text()
    nights = page.locator("table").first.locator("tbody tr").all_inner_texts()
    assert [line.split("\t")[0] for line in nights] == NIGHTS[::-1] and "regression" in nights[0] and nights[1].endswith("4\t2")


def test_page_needs_nothing_but_itself_and_is_the_same_twice(run_page, report_folder, history_file, history_page, tmp_path):
    runner = CliRunner()
    for source, file in ((report_folder, run_page), (history_file, history_page)):
        ended = runner.invoke(app, ["page", str(source), "--out", str(tmp_path / "again.html")])
        assert ended.exit_code == 0, ended.output
        assert (tmp_path / "again.html").read_bytes() == file.read_bytes()
        page = re.sub(r"<script>.*?</script>", "", file.read_text(), flags=re.S)
        assert not re.findall(r"""(?:src|href)=["'](?!#|data:)""", page)


def test_pages_of_nothing(tmp_path, open_page):
    with history.open_history(tmp_path / "empty.sqlite"):
        pass
    write_history_page(tmp_path / "empty.sqlite", tmp_path / "empty.html")
    assert "0 nights" in open_page(tmp_path / "empty.html").locator("body").inner_text()


def test_time_series_keep_both_sides_of_every_event(report_folder):
    from stiction.reports.page.run_page import SAMPLE, _frame

    for record in read_run(report_folder).validation().records:
        if record.trajectory is not None:
            frame = _frame(record.trajectory)
            events = [event.time for event in record.trajectory.events]
            assert all((frame["t"] == time).sum() >= 2 for time in events)
            samples = pd.Index(frame["t"]).difference(events)
            assert np.diff(samples).min() > 0.9 * SAMPLE
