"""The pages in a real browser: they open without errors and without a network; zoom, cursor, mechanism and keyboard work."""

import json
import re
import time
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from conftest import invoke
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from report_material import unsaved_figures, validation_of

from stiction.comparisons.bench.planned_runs import Metric, Row
from stiction.comparisons.bench.results import Results
from stiction.comparisons.regression import history
from stiction.reports import report_of, write_report
from stiction.reports.page import write_history_page, write_run_page
from stiction.reports.page.time_series import MAX_DEVIATION, SAMPLE_STEP, decimate
from stiction.reports.run_folder.stored_run import read_run
from stiction.scenes.pictures.web import LONG, SHORT, Columns

NIGHTS = [f"2026-03-{day:02d}T02:00:00.000Z" for day in (1, 2, 3)]
CASES = ("slider-bar-case-1", "slider-bar-case-2")

MOST_MB, MOST_CURVES, LONGEST = 1.5, 3 * 15, 24.0
"""What a page may weigh, and the time series of a full campaign: three cases of 24 s, 14 variants and the truth."""


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
                    metrics = (
                        ()
                        if lost
                        else (
                            Metric(
                                "position_error",
                                "accuracy",
                                1e-3 * (number + 1),
                                1e-9,
                                "closed form",
                            ),
                            Metric("time of the run [s]", "time", 0.5, 0.01),
                            Metric("pivots [-]", "counter", 133.0),
                        )
                    )
                    opened.append(
                        night,
                        Row(
                            f"{scene}/{variant}/dt=0.01",
                            f"{variant}; scene {scene}",
                            scene,
                            variant,
                            variant,
                            "1",
                            "joint",
                            "dt",
                            0.01,
                            "crashed" if lost else "ok",
                            "<script>alert('SIGSEGV')</script>" if lost else "",
                            {},
                            metrics,
                        ),
                    )
            opened.finish(night, "regression" if number == 2 else "fine")
    return file


@pytest.fixture(scope="module")
def history_page(history_file):
    write_history_page(history_file, file := history_file.with_suffix(".html"))
    return file


@pytest.fixture
def open_page(watched_page):
    """A function that opens a file; see `watched_page`."""
    return lambda file, **options: watched_page(file.as_uri(), file.as_uri(), **options)


def until(found: Callable[[], object], expected: object) -> None:
    """Wait until `found` yields what is expected; the page's own rules forbid playwright to wait in it."""
    end = time.monotonic() + 600
    while found() != expected and time.monotonic() < end:
        time.sleep(0.05)
    assert found() == expected


def said(page) -> list[str]:
    """What a screen reader says of each panel: quantity, range of time, names of the lines."""
    return page.evaluate(
        "() => [...document.querySelectorAll('.panel canvas')].map(canvas => canvas.getAttribute('aria-label'))"
    )


def spans(page) -> list[tuple[float, float]]:
    """The range of time of each panel."""
    return [
        (float(found[1]), float(found[2]))
        for label in said(page)
        if (found := re.search(r" from (\S+) to (\S+):", label))
    ]


def names(page, panel: int = 0) -> list[str]:
    """Of the lines in a panel."""
    return said(page)[panel].partition(": ")[2].split("; ")


def panel_box(page, place: int = 0) -> dict:
    panel = page.locator(".panel canvas").nth(place)
    panel.scroll_into_view_if_needed()
    return panel.bounding_box()


def drag(page, start=(0.4, 0.3), end=(0.6, 0.3)) -> None:
    """Over shares of the first panel's lines, which leave 62 px and 10 px of its width."""
    box = panel_box(page)
    place = [
        (box["x"] + 62 + share * (box["width"] - 72), box["y"] + height * box["height"])
        for share, height in (start, end)
    ]
    page.mouse.move(*place[0])
    page.mouse.down()
    page.mouse.move(*place[1], steps=5)
    page.mouse.up()


def mechanism(page) -> str:
    """The pixels of the mechanism."""
    return page.evaluate("() => document.querySelector('.film canvas').toDataURL()")


def shown_time(page) -> float:
    return float(page.locator(".film output").inner_text().removeprefix("t = ").removesuffix(" s"))


def test_zoom_changes_all_panels_and_reset_brings_them_back(run_page, open_page):
    page = open_page(run_page)
    before = spans(page)
    assert len(before) > 5 and set(before) == {(0.0, 9.0)}
    drag(page)
    zoomed = spans(page)
    assert len(set(zoomed)) == 1 and len(zoomed) == len(before)
    np.testing.assert_allclose(
        zoomed[0], [3.6, 5.4], atol=0.05
    )  # 0.4 and 0.6 of 9 s, to a pixel or two
    page.get_by_role("button", name="Reset zoom").click()
    assert spans(page) == before
    drag(page)
    box = panel_box(page)
    page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert spans(page) == before
    page.locator(".board").focus()
    page.keyboard.press("+")
    assert spans(page)[0][1] - spans(page)[0][0] == pytest.approx(4.5, abs=2.3)
    page.keyboard.press("0")
    assert spans(page) == before


def test_a_name_hides_and_shows_its_lines_in_all_panels(run_page, open_page):
    page = open_page(run_page)
    name = "other (dt = 0.0025 s)"
    assert name in names(page) and "paper's scheme (dt = 0.0025 s)" not in names(page)
    page.get_by_label(name, exact=True).uncheck()
    assert not any(name in label for label in said(page))
    page.get_by_label(name, exact=True).check()
    assert name in names(page) and name in names(page, 2)


def test_the_pointer_moves_cursor_and_mechanism_and_tells_full_names_and_values(
    run_page, report_folder, open_page
):
    page = open_page(run_page)
    start, box = mechanism(page), panel_box(page)
    page.mouse.move(box["x"] + 62 + (box["width"] - 72) / 3, box["y"] + 60)
    assert shown_time(page) == pytest.approx(3.0, abs=0.02) and mechanism(page) != start
    [record] = [
        record
        for record in read_run(report_folder).validation().records
        if record.variant.label == "reference" and record.trajectory is not None
    ][-1:]
    told = dict(line.rsplit(": ", 1) for line in page.locator(".tip div").all_inner_texts())
    assert set(told) == set(names(page))
    value = next(float(text) for name, text in told.items() if name.startswith("reference ("))
    expected = np.interp(
        shown_time(page), record.trajectory.t, record.trajectory["guide.displacement"]
    )
    assert value == pytest.approx(
        expected, abs=1e-3
    )  # five digits, and the time is told to a millisecond


def test_differences_from_the_truth_are_small_where_the_run_is_good(run_page, open_page):
    page = open_page(run_page)
    page.get_by_label("Show").select_option("differences from the truth")
    assert all(
        label.startswith("|difference| of ") for label in said(page)
    ) and "truth" not in names(page)
    box = panel_box(page)
    page.mouse.move(box["x"] + 62 + (box["width"] - 72) / 2, box["y"] + 60)
    told = dict(line.rsplit(": ", 1) for line in page.locator(".tip div").all_inner_texts())
    assert all(0 < float(text) < 1e-2 for text in told.values() if text != "–") and len(told) >= 2
    reference = next(text for name, text in told.items() if name.startswith("reference ("))
    assert reference == "–" or float(reference) < 1e-6


def test_keyboard_plays_pauses_and_steps(run_page, open_page):
    page = open_page(run_page)
    page.locator(".board").focus()
    start = mechanism(page)
    page.keyboard.press("ArrowRight")
    first = shown_time(page)
    assert 0 < first < 0.05
    page.keyboard.press("Shift+ArrowRight")
    assert shown_time(page) > first + 5 * SAMPLE_STEP
    page.keyboard.press("ArrowLeft")
    page.keyboard.press(" ")
    assert page.get_by_role("button", name="Pause").count() == 1
    until(lambda: shown_time(page) > 0.5, True)
    page.keyboard.press(" ")
    at, drawn = shown_time(page), mechanism(page)
    assert page.get_by_role("button", name="Play").count() == 1 and drawn != start
    page.wait_for_timeout(200)
    assert shown_time(page) == at and mechanism(page) == drawn
    until(
        lambda: page.locator(".said").inner_text().startswith(f"t = {at:.3f} s, "), True
    )  # for a screen reader
    page.get_by_role("slider", name="Time, s").fill("2")
    assert shown_time(page) == pytest.approx(2.0)


def test_sections_are_closed_and_keys_open_the_one_with_their_rows(
    run_page, report_folder, open_page
):
    page, run = open_page(run_page), read_run(report_folder)
    said = report_of(run.validation()).sections
    headings = [
        "Answer",
        "Time series",
        *(study.question for study in said),
        "Where numbers come from",
        "Provenance",
    ]
    assert page.locator("h2").all_inner_texts() == headings
    sections = page.locator("section > details")
    assert sections.count() == len(said) + 1 and all(
        sections.nth(number).get_attribute("open") is None for number in range(sections.count())
    )
    link = page.locator('a[href^="#key-threshold-"]').first
    link.evaluate("link => link.closest('details').open = true")
    link.click()
    until(lambda: sections.last.get_attribute("open") is not None, True)
    origin = page.locator(link.get_attribute("href"))
    assert origin.is_visible() and "data/threshold.csv, row 1" in origin.inner_text()
    text = run_page.read_text()
    targets, places = (
        set(re.findall(r'href="#(key-[^"]*)"', text)),
        re.findall(r'id="(key-[^"]*)"', text),
    )
    assert targets and sorted(targets) == sorted(places)


def test_a_film_plays_in_a_browser(validation, tmp_path, open_page):
    run = validation.records[0].trajectory
    run.animate(tmp_path / "film.html")
    page = open_page(tmp_path / "film.html")
    start = mechanism(page)
    page.keyboard.press(" ")
    until(lambda: shown_time(page) > 0.2, True)
    page.keyboard.press(" ")
    assert mechanism(page) != start
    assert f"at {shown_time(page):.3f} s" in page.locator(".film canvas").get_attribute(
        "aria-label"
    )


def test_history_draws_each_metric_s_course(history_page, open_page):
    page = open_page(history_page)
    metric, scene = page.locator(".controls select").all()
    assert metric.locator("option").all_inner_texts() == [
        "position error [m]",
        "time of the run [s]",
        "pivots [-]",
    ]
    assert scene.locator("option").all_inner_texts() == list(CASES)

    def lines() -> dict[str, list]:
        """By name the values that the pointer is told at each night."""
        found: dict[str, list] = {}
        for night in range(len(NIGHTS)):
            box = panel_box(page)
            page.mouse.move(
                box["x"] + 62 + (night + 0.3) / 2.6 * (box["width"] - 72), box["y"] + 60
            )
            assert (
                NIGHTS[night] in page.locator(".tip strong").inner_text()
                and f"abc{night}" in page.locator(".tip strong").inner_text()
            )
            for text in page.locator(".tip div").all_inner_texts():
                name, value = re.fullmatch(r"(.*): (\S+) \(.*\)", text).groups()
                found.setdefault(name, []).append(None if value == "–" else float(value))
        return found

    assert lines() == {
        "reference (dt = 0.01 s)": [1e-3, 2e-3, 3e-3],
        "other (dt = 0.01 s)": [1e-3, None, 3e-3],
    }
    before = said(page)
    drag(page)
    assert said(page) != before
    metric.select_option("pivots [-]")
    scene.select_option(CASES[1])
    until(lambda: said(page)[0].startswith("pivots [-]"), True)
    assert lines() == {
        "reference (dt = 0.01 s)": [133, 133, 133],
        "other (dt = 0.01 s)": [133, None, 133],
    }
    page.set_viewport_size({"width": 900, "height": 700})
    page.wait_for_timeout(100)  # what was shown before would draw itself again
    assert said(page)[0].startswith("pivots [-]")
    assert "<script>alert('SIGSEGV')</script>" in page.locator("table").last.inner_text()
    nights = page.locator("table").first.locator("tbody tr").all_inner_texts()
    assert (
        [line.split("\t")[0] for line in nights] == NIGHTS[::-1]
        and "regression" in nights[0]
        and nights[1].endswith("4\t2\t0\t2")  # runs, complete, not applicable, failed
    )


def test_page_needs_nothing_but_itself_and_is_the_same_twice(
    run_page, report_folder, history_file, history_page, tmp_path
):
    for source, file in ((report_folder, run_page), (history_file, history_page)):
        invoke("page", source, "--out", tmp_path / "again.html")
        assert (tmp_path / "again.html").read_bytes() == file.read_bytes()
        page = re.sub(r"<script\b.*?</script>", "", file.read_text(), flags=re.S)
        assert not re.findall(
            r"""(?:src|href)=["'](?!#|data:)""", re.sub(r'src="data:[^"]*"', "", page)
        )


def test_a_browser_that_cannot_read_the_data_says_so(history_page, browser):
    page = browser.new_context(offline=True).new_page()
    page.add_init_script("delete window.DecompressionStream;")
    page.goto(history_page.as_uri())
    until(lambda: "could not be read" in page.locator(".board").inner_text(), True)
    page.context.close()


def test_pages_of_nothing(lost_records, truths, tmp_path, open_page):
    for name, few in (
        ("lost", validation_of(lost_records, truths)),
        ("nothing", Results((), {}, {})),
    ):
        with unsaved_figures():
            write_report(report_of(few), tmp_path / name)
        write_run_page(read_run(tmp_path / name), tmp_path / f"{name}.html")
        page = open_page(tmp_path / f"{name}.html")
        assert page.locator("h2").first.inner_text() == "Answer"
        if name == "lost":  # the truth alone
            assert names(page) == ["truth"] and page.get_by_label("Mechanism of").locator(
                "option"
            ).all_inner_texts() == ["truth"]
    with history.open_history(tmp_path / "empty.sqlite"):
        pass
    write_history_page(tmp_path / "empty.sqlite", tmp_path / "empty.html")
    assert "0 nights" in open_page(tmp_path / "empty.html").locator("body").inner_text()


def test_time_series_keep_both_sides_of_every_event_and_what_can_be_seen(report_folder):
    for record in read_run(report_folder).validation().records:
        if record.trajectory is not None:
            whole = record.trajectory.to_frame(events=True, interpolated=True)
            columns = ["slider.vx", "guide.F1", "motor.effort"]
            ranges = {column: (whole[column].min(), whole[column].max()) for column in columns}
            frame = decimate(whole, ranges)
            events = [event.time for event in record.trajectory.events]
            assert all(
                (frame["t"] == time).sum() == (whole["t"] == time).sum() >= 2 for time in events
            )
            smooth = whole[~whole["t"].isin(events)]
            for column, (low, high) in ranges.items():
                missed = np.abs(np.interp(smooth["t"], frame["t"], frame[column]) - smooth[column])
                assert missed.max() < 4 * MAX_DEVIATION * (high - low), column


def test_a_peak_between_two_samples_is_kept():
    t = np.linspace(0, 1, 1001)
    frame = pd.DataFrame({"t": t, "force": np.where(np.isclose(t, 0.5047), 0.0, np.sin(t))})
    frame.loc[505, "force"] = 9.0
    assert decimate(frame, {"force": (0.0, 1.0)})["force"].max() == 9.0
    assert len(decimate(frame, {"force": (0.0, 1.0)})) < 110


@given(
    arrays(float, st.integers(0, 60), elements=st.floats(-1e6, 1e6) | st.just(np.nan)),
    st.sampled_from([SHORT, LONG]),
    st.sampled_from([0.0, 1e-3, 10.0]),
)
def test_columns_lose_no_more_than_half_a_step(values, bits, coarse):
    """Read as ``unpack`` of ``data.js`` reads them."""
    block = Columns()
    block.add([1.0, 2.0])
    block.add(values, bits, coarse)
    (_, rows, low, step, order), data = block.about[1], bytes(block.data[4:])
    whole = (
        np.frombuffer(data, np.uint8)
        .reshape(bits // 8, rows)
        .T.copy()
        .view(f"<u{bits // 8}")
        .ravel()
    )
    for _ in range(order):
        whole = np.cumsum(whole, dtype=whole.dtype)
    read = np.where(whole == 2**bits - 1, np.nan, low + step * whole.astype(float))
    np.testing.assert_array_equal(np.isnan(read), np.isnan(values))
    known = ~np.isnan(values)
    if known.any():
        assert np.abs(read - values)[known].max() <= 0.501 * step and step <= max(
            np.ptp(values[known]) / (2**bits - 2), 1.0, coarse
        )


@pytest.mark.parametrize("which", ["run_page", "history_page"])
def test_a_narrow_screen_needs_no_scrolling_sideways(which, request, open_page):
    page = open_page(request.getfixturevalue(which), width=390, height=844)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    clipped = page.evaluate("""() => [...document.querySelectorAll("h1, h2, nav, .controls, .legend, .panel .title, figcaption")]
        .filter(element => element.getBoundingClientRect().right > innerWidth + 1).length""")
    assert clipped == 0
    assert (
        page.locator("details").first.get_attribute("open") is None
    )  # the names of the lines do not cover the lines
    box = page.locator(".table").last
    box.scroll_into_view_if_needed()
    box.evaluate("box => { box.scrollLeft = 120; }")
    first = box.locator("tbody tr").first.locator("td").first.bounding_box()
    assert first["x"] == pytest.approx(box.bounding_box()["x"], abs=1)  # the first column stays


def test_a_page_is_small(run_page):
    """Less than 1.5 MB, and so would be that of a full campaign, if its time series are like these."""
    text = run_page.read_text()
    series = re.findall(
        r'<script type="application/json" data-labels[^>]*>(.*?)</script>', text, re.S
    )
    curves = [curve for view in map(json.loads, series) for curve in view["series"]]
    seconds = json.loads(series[0])["x"]["range"][1]
    rest = len(text) - sum(map(len, series))
    assert (
        sum(map(len, series)) / len(curves) / seconds * MOST_CURVES * LONGEST + rest < MOST_MB * 1e6
    )


def test_figures_are_in_the_page_with_words_for_those_who_do_not_see_them(
    run_page, report_folder, open_page
):
    page = open_page(run_page)
    page.evaluate(
        "() => document.querySelectorAll('details').forEach(part => { part.open = true; })"
    )
    page.evaluate("() => [...document.images].forEach(image => { image.loading = 'eager'; })")
    until(
        lambda: page.evaluate(
            "() => [...document.images].every(image => image.naturalWidth > 600)"
        ),
        True,
    )
    pictures = {file.stem for file in (report_folder / "figures").glob("*.svg")}
    assert (
        set(
            page.evaluate(
                "() => [...document.querySelectorAll('.picture')].map(picture => picture.getAttribute('aria-label'))"
            )
        )
        == pictures
    )
    alternative_texts = page.evaluate("() => [...document.images].map(image => image.alt)")
    assert all(words.strip() for words in alternative_texts)
    assert page.evaluate(
        "document.documentElement.scrollWidth <= innerWidth"
    )  # wide tables scroll on their own
