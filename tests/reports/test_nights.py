"""A night says in five lines what happened, and the page of all nights opens on what became worse."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

from stiction.comparisons.bench.planned_runs import Metric, Row
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.regression import history
from stiction.comparisons.regression.check import (
    COULD_NOT_RUN,
    NEW,
    NOT_JUDGED,
    REGRESSION,
    Finding,
)
from stiction.comparisons.regression.night_changes import engine_versions, environment_changes
from stiction.comparisons.regression.nightly import Result
from stiction.engines.status import Status
from stiction.reports.markdown.regression_report import (
    check_report,
    night_report,
    summary_lines,
    write_night,
)
from stiction.reports.page import write_history_page
from stiction.reports.page.night_charts import short_names

NIGHTS = ("2026-03-01T02:17:00.000Z", "2026-03-01T14:17:00.000Z", "2026-03-02T02:17:00.000Z")
ERROR, DRIFT = "position_error", "position drift [m]"
WORST = Finding(
    REGRESSION, "drift", "block/pymunk/dt=0.01", DRIFT, 1e-6, 5e-6, 5.0, "5 times the baseline's"
)


def origin(numba: str, commit: str) -> dict:
    return {
        "conditions": "processor",
        "commit": commit,
        "versions": {"python": "3.11.7", "numba": numba},
        "machine": {"cpu": "processor", "os": "Linux"},
    }


def row(
    scene: str,
    engine: str,
    status: str = "ok",
    reason: str = "",
    version: str | None = "1.0",
    value: float = 1e-3,
) -> Row:
    metrics = (
        (Metric(ERROR, "accuracy", value), Metric(DRIFT, "drift", value)) if status == "ok" else ()
    )
    return Row(
        f"{scene}/{engine}/dt=0.01",
        f"{engine}; {scene}",
        scene,
        engine,
        engine,
        version,
        "joint",
        "dt",
        0.01,
        status,
        reason,
        {},
        metrics,
    )


ROWS = (
    row("sled", "pymunk"),
    row("block", "pymunk"),
    row("sled", "drake", "missing", "drake: not installed", None),
    row("block", "drake", "missing", "drake: not installed", None),
    row("block", "reference", Status.NOT_RUN, "the 60 s of the campaign were over", None),
)
ABSENT = [
    Finding(
        NOT_JUDGED,
        "status",
        f"{scene}/drake/dt=0.01",
        "",
        "ok",
        "missing",
        1.0,
        "drake: not installed",
    )
    for scene in ("sled", "block")
]


def result(night: str, findings=(WORST, *ABSENT), verdict=REGRESSION, **more) -> Result:
    return Result(
        night,
        SimpleNamespace(name="c"),
        ROWS,
        tuple(findings),
        verdict,
        origin("0.62.1", "b" * 40),
        2,
        93.4,
        **more,
    )


class TestFiveLines:
    def test_verdict_worst_finding_environment_time_and_what_was_not_run(self):
        lines = summary_lines(
            result(NIGHTS[1], night_before=NIGHTS[0], changed=("numba 0.61.0 -> 0.62.1",))
        )
        assert len(lines) == 5 and "**regression**" in lines[0] and "5 runs" in lines[0]
        assert (
            DRIFT in lines[1]
            and "block/pymunk/dt=0.01" in lines[1]
            and "1e-06 -> 5e-06" in lines[1]
        )
        assert lines[2] == f"Environment: since the night {NIGHTS[0]}: numba 0.61.0 -> 0.62.1"
        assert (
            lines[3] == "Time: 93 s"
            and lines[4]
            == "Not run: engines not available: drake (2 runs); 1 run: the 60 s of the campaign were over"
        )

    def test_the_first_night_and_one_without_changes(self):
        assert "no night before" in summary_lines(result(NIGHTS[0]))[2]
        assert summary_lines(result(NIGHTS[1], night_before=NIGHTS[0]))[2].endswith(
            ": nothing changed"
        )
        assert (
            summary_lines(result(NIGHTS[0], findings=ABSENT, verdict="fine"))[1]
            == "Worst finding: none"
        )

    @pytest.mark.parametrize("written", [check_report, night_report])
    def test_they_stand_first_and_what_is_not_installed_is_one_line(self, written):
        many = replace(
            result(NIGHTS[0]),
            rows=(
                *ROWS,
                *(
                    row(f"scene {number}", "drake", "missing", "drake: not installed", None)
                    for number in range(190)
                ),
            ),
            findings=(
                WORST,
                *(replace(ABSENT[0], key=f"scene {number}/drake/dt=0.01") for number in range(190)),
            ),
        )
        text = written(many)
        assert all(line in text for line in summary_lines(many)) and "192 runs" in text
        assert sum("drake" in line for line in text.splitlines()) == 1
        assert "scene 7" not in text

    def test_an_engine_that_a_campaign_needs_is_one_row_for_all_its_variants(self):
        lost = [
            Finding(
                COULD_NOT_RUN,
                "status",
                f"block/{variant}/dt=0.01",
                "",
                "ok",
                "missing",
                1.0,
                "pymunk: not installed",
            )
            for variant in ("a", "b", "c")
        ]
        table = check_report(replace(result(NIGHTS[0]), rows=ROWS[:2], findings=tuple(lost)))
        assert len([line for line in table.splitlines() if line.startswith("| could not run")]) == 1

    def test_what_is_new_is_no_worst_finding(self):
        new = Finding(
            NEW, "status", "sled/pymunk/dt=0.01", "", None, "ok", 1.0, "not in the baseline"
        )
        assert (
            summary_lines(replace(result(NIGHTS[0]), findings=(new,)))[1] == "Worst finding: none"
        )

    def test_a_run_with_a_wrong_result_is_not_said_to_have_failed_to_run(self):
        wrong = Finding(
            COULD_NOT_RUN, "status", "sled/pymunk/dt=0.01", "", None, "wrong", 1.0, "error 2 m"
        )
        written = replace(result(NIGHTS[0]), findings=(wrong,), verdict=COULD_NOT_RUN)
        assert summary_lines(written)[1] == (
            "Worst finding: no valid result, sled/pymunk/dt=0.01: wrong (it ran, but its result is not a motion "
            "of the scene); error 2 m"
        )
        assert "could not run" not in night_report(written)

    def test_refusals_are_grouped_by_reason_apart_from_failures(self):
        rows = (
            row("sled", "pymunk", "refused", "no play"),
            row("block", "drake", "refused", "no play"),
            row("sled", "drake", "ok", "stopped at t = 1 s"),
        )
        text = night_report(replace(result(NIGHTS[0]), rows=rows, findings=()))
        failed, refused = (
            text.partition(f"## {heading}")[2].partition("##")[0]
            for heading in ("What failed", "Not applicable")
        )
        assert "incomplete" in failed and "stopped" in failed and "no play" not in failed
        assert len([line for line in refused.splitlines() if "no play" in line]) == 1
        assert (
            "2 not applicable, 1 ended early"
            in summary_lines(replace(result(NIGHTS[0]), rows=rows))[0]
        )


class TestChanges:
    def test_versions_machine_and_commit(self):
        before, now = (
            origin("0.61.0", "a" * 40),
            {**origin("0.62.1", "b" * 40 + "-dirty"), "machine": {"cpu": "other", "os": "Linux"}},
        )
        assert environment_changes(
            before, now, {"pymunk": "7.1", "old": "1"}, {"pymunk": "7.3", "new": "2"}
        ) == [
            "pymunk 7.1 -> 7.3",
            "numba 0.61.0 -> 0.62.1",
            "cpu processor -> other",
            "commit aaaaaaaaaaaa -> bbbbbbbbbbbb-dirty",
        ]
        assert environment_changes(before, before, {"pymunk": "7.1"}, {"pymunk": "7.1"}) == []

    def test_versions_of_engines(self):
        assert engine_versions([("a", "1"), ("b", None), ("a", "1"), ("a", "2")]) == {
            "a": "1 and 2"
        }


class TestPage:
    @pytest.fixture()
    def folder(self, tmp_path, monkeypatch):
        """Two nights of one day and one more; the last has a regression of the second metric on the second scene."""
        with history.open_history(tmp_path / "history.sqlite") as opened:
            for number, night in enumerate(NIGHTS):
                monkeypatch.setattr(history, "_now", lambda night=night: night)
                opened.begin("c", "digest", origin("0.61.0" if number < 2 else "0.62.1", "a" * 40))
                for one in ROWS:
                    opened.append(night, one)
                opened.finish(night, REGRESSION if number == 2 else "fine")
                write_night(
                    result(night) if number == 2 else result(night, ABSENT, "fine"),
                    3,
                    tmp_path / night.replace(":", ""),
                )
        return tmp_path

    def views(self, page: str) -> list[tuple[list[str], dict]]:
        found = re.findall(r'<script[^>]*data-labels="([^"]*)"[^>]*>(.*?)</script>', page, re.S)
        return [
            (json.loads(labels.replace("&quot;", '"')), json.loads(content))
            for labels, content in found
        ]

    def test_it_opens_on_the_worst_finding_and_marks_it(self, folder):
        write_history_page(folder / "history.sqlite", folder / "page.html")
        page = (folder / "page.html").read_text()
        views = self.views(page)
        assert [labels for labels, _ in views][0] == [DRIFT, "block"]
        flags = {
            (tuple(labels), series["about"]): series["flags"]
            for labels, content in views
            for series in content["series"]
        }
        assert flags.pop(((DRIFT, "block"), WORST.key)) == [2] and not any(flags.values())
        assert [content["x"]["short"] for _, content in views][0] == [
            "03-01 02:17",
            "03-01 14:17",
            "2026-03-02",
        ]

    def test_it_says_what_changed_and_leads_to_the_reports(self, folder):
        write_history_page(folder / "history.sqlite", folder / "page.html")
        page = (folder / "page.html").read_text()
        assert page.index("The newest night") < page.index("Course over the nights")
        assert all(
            re.sub(r"\*\*", "", line.partition("->")[0])[:40] in re.sub(r"</?strong>", "", page)
            for line in summary_lines(result(NIGHTS[2]))
        )
        assert page.count("numba 0.61.0 -&gt; 0.62.1") == 1 and "3 nights, 5 runs" in page
        for night in NIGHTS:
            assert f'href="{night.replace(":", "")}/report.md"' in page
        assert (
            "Engines not available in some of the nights: drake (2 runs a night)." in page
            and page.count("drake") == 2
        )  # and in the lines of the night

    def test_the_table_of_failures_has_no_status_ok_and_no_refusals(self, tmp_path):
        rows = (
            row("sled", "pymunk", "refused", "no play"),
            row("sled", "drake", "ok", "stopped early"),
            row("sled", "toy", "failed", "singular"),
        )
        with history.open_history(tmp_path / "history.sqlite") as opened:
            night = opened.begin("c", "digest", origin("0.61.0", "a" * 40))
            for one in rows:
                opened.append(night, one)
        write_history_page(tmp_path / "history.sqlite", tmp_path / "page.html")
        page = (tmp_path / "page.html").read_text()
        failed, refused = (
            page.partition(f">{heading}</h2>")[2].partition("</section>")[0]
            for heading in ("What failed", "Not applicable")
        )
        assert ">ok<" not in failed and ">incomplete<" in failed and ">failed<" in failed
        assert "no play" in refused and "no play" not in failed and "singular" not in refused
        assert f'<abbr title="{"a" * 40}">{"a" * 12}</abbr>' in page

    def test_lines_of_a_chart_differ_and_the_position_error_is_shown_first(self, tmp_path):
        engines = [f"engine {number}" for number in range(20)]
        with history.open_history(tmp_path / "history.sqlite") as opened:
            night = opened.begin("c", "digest", origin("0.61.0", "a" * 40))
            for engine in engines:
                for step in (0.01, 0.001):
                    one = row("sled", engine)
                    metrics = tuple(reversed(one.metrics))  # the position error is the second
                    key = f"sled/{engine}/dt={step}"
                    opened.append(night, replace(one, key=key, step=step, metrics=metrics))
        write_history_page(tmp_path / "history.sqlite", tmp_path / "page.html")
        [(labels, content), *_] = self.views((tmp_path / "page.html").read_text())
        assert labels == [quantity_of(ERROR).head, "sled"]
        looks = [(series["color"], tuple(series["dash"])) for series in content["series"]]
        assert len(looks) == len(set(looks)) == 40

    def test_a_page_elsewhere_leads_there_too_and_a_history_alone_has_a_page(self, folder):
        (folder / "sub").mkdir()
        write_history_page(folder / "history.sqlite", folder / "sub" / "page.html")
        assert (
            f'href="../{NIGHTS[2].replace(":", "")}/report.md"'
            in (folder / "sub" / "page.html").read_text()
        )
        alone = folder / "sub" / "history.sqlite"
        alone.write_bytes((folder / "history.sqlite").read_bytes())
        write_history_page(alone, folder / "sub" / "alone.html")
        assert "report.md" not in (folder / "sub" / "alone.html").read_text()

    def test_one_night(self, tmp_path):
        with history.open_history(tmp_path / "history.sqlite") as opened:
            opened.append(opened.begin("c", "digest", origin("0.61.0", "a" * 40)), ROWS[0])
        write_history_page(tmp_path / "history.sqlite", tmp_path / "page.html")
        page = (tmp_path / "page.html").read_text()
        assert "1 night, 1 run each at most" in page and "not finished" in page

    def test_a_night_that_is_not_finished_says_so_after_others_that_are(self, folder, monkeypatch):
        monkeypatch.setattr(history, "_now", lambda: "2026-03-09T02:17:00.000Z")
        with history.open_history(folder / "history.sqlite") as opened:
            opened.append(opened.begin("c", "other digest", origin("0.62.1", "a" * 40)), ROWS[0])
        write_history_page(folder / "history.sqlite", folder / "page.html")
        assert "<strong>not finished</strong>" in (folder / "page.html").read_text()


def test_names_of_nights_at_an_axis_tell_them_apart():
    nights = [
        "2026-03-01T02:17:00.000Z",
        "2026-03-02T02:17:00.000Z",
        "2026-03-02T02:17:30.500Z",
        "2026-03-02T03:00:00.000Z",
    ]
    names = short_names(nights)
    assert names == ["2026-03-01", "03-02 02:17:00.000", "03-02 02:17:30.500", "03-02 03:00"]
