"""Judgement of tables: the truth is right, every way to be wrong is seen, and nothing is charged that samples cannot show."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from made_up_runs import wrongly_written

import stiction
from stiction.comparisons.bench.results import Results
from stiction.comparisons.judge.judgement import (
    FOUND,
    INVENTED,
    MISSED,
    UNRESOLVED,
    judge,
)
from stiction.comparisons.judge.judgement_presentation import presentation
from stiction.comparisons.judge.prescribed_coordinates import prescribed
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.reports.judgement_page import judgement_section
from stiction.scenes import load_scene
from stiction.scenes.result_table import parse_units
from stiction.scenes.trajectory import events_frame

CASE = "slider-bar-case-1"
pytestmark = pytest.mark.usefixtures("compiled")
POSITIONS, VELOCITIES = (".x", ".y", ".angle"), (".vx", ".vy", ".omega")


def true_table(step=0.01, two_sided=False, name=CASE, **overrides):
    """The truth itself as somebody's results."""
    truth = ground_truth(load_scene(name, overrides))
    t = np.append(np.arange(0.0, truth.t_end - step / 2, step), truth.t_end)
    frame = pd.DataFrame({"t": t, **truth(t)})
    if not two_sided:
        return frame
    sides = [
        {"t": event.time, **side} for event in truth.events for side in (event.before, event.after)
    ]
    return pd.concat([frame, pd.DataFrame(sides)]).sort_values(
        "t", kind="stable", ignore_index=True
    )


@cache
def own_run(name):
    scene = load_scene(name)
    return scene, stiction.load_engine("reference").simulate(
        scene, rtol=1e-9, output_step=scene.t_end / 1000
    )


def only(frame, *endings):
    return frame[["t", *(name for name in frame if name.endswith(endings))]]


def error_of(judged, column):
    return judged.tables["errors"].set_index("column").loc[column]


def rows_of(judged):
    """What the text of a judgement mentions."""
    return presentation(judged).rows


def verdicts(judged):
    return list(judged.tables["stick-phases"]["verdict"])


@pytest.fixture(scope="module")
def frame():
    return true_table()


class TestRight:
    @pytest.mark.parametrize("two_sided", [False, True])
    def test_truth_is_right_in_every_respect(self, two_sided):
        judged = judge(CASE, true_table(two_sided=two_sided))
        table = judged.tables["errors"]
        assert (table["error"] <= table["uncertainty"] + 1e-12).all() and set(table["hint"]) == {""}
        assert judged.error < 1e-12 and judged.is_complete and not judged.is_misread
        assert set(verdicts(judged)) == {FOUND}
        assert judged.tables["jumps"]["resolved"].all() and len(judged.tables["jumps"]) == 15
        assert judged.tables["findings"].empty
        summary = judged.tables["summary"].loc[0]
        assert (
            summary["energy_error"]
            <= summary["energy_uncertainty"]
            < 0.01 * summary["energy_exchanged"]
        )
        if two_sided:  # efforts are exact
            assert (
                error_of(judged, "motor.effort")["uncertainty"] < 1e-8
                and summary["events_matched"] == 25
            )
            assert judged.tables["jumps"]["jump_error"].abs().max() < 1e-9

    def test_positions_are_enough(self, frame):
        judged = judge(CASE, only(frame, *POSITIONS))
        assert judged.error < 1e-12 and set(verdicts(judged)) == {FOUND}
        assert judged.tables["summary"].at[0, "position_drift"] < 1e-12
        summary = rows_of(judged)["summary"]
        assert float(summary["completed_energy_error"]) < 0.01 * float(
            summary["completed_energy_exchanged"]
        )
        assert summary["energy_error"] is None

    def test_nothing_between_samples_is_charged(self):
        """A tenth of a second between samples bends an interpolated position by millimetres."""
        judged = judge(CASE, true_table(step=0.1))
        effort = error_of(judged, "motor.effort")
        assert judged.error < 1e-12 and effort["error"] <= effort["uncertainty"]

    @pytest.mark.parametrize("two_sided", [False, True])
    @pytest.mark.parametrize(
        "name",
        [
            "coulomb-oscillator",
            "elliptic-trammel",
            "hard/wedged-slider",
            "hard/three-stop-at-once",
            "hard/three-guides-at-rest",
            "hard/trammel-at-rest",
            "hard/trammel-comes-to-rest",
        ],
    )
    def test_nothing_is_held_against_a_run_of_ours(self, name, two_sided):
        """With many events, events at the end of a sample, at one instant, in independent parts, and without any motion."""
        scene, run = own_run(name)
        judged = judge(scene, run if two_sided else run.to_frame())
        assert judged.error < 1e-8 and not judged.hints and judged.tables["findings"].empty
        assert {MISSED, INVENTED}.isdisjoint(verdicts(judged))
        assert not judged.tables["summary"].get("events_spurious", pd.Series([0]))[0]

    def test_angles_may_be_wrapped(self, frame):
        wrapped = frame.assign(**{"bar.angle": np.angle(np.exp(1j * frame["bar.angle"]))})
        judged = judge(CASE, only(wrapped, *POSITIONS))
        assert judged.error < 1e-12 and judged.tables["summary"].at[0, "position_drift"] < 1e-12


class TestWrong:
    def test_another_friction_coefficient(self, frame):
        other = true_table(mu=0.035)
        judged = judge(CASE, other)
        assert judged.error == pytest.approx(
            np.abs(other["slider.x"] - frame["slider.x"]).max(), rel=0.01
        )
        assert INVENTED in verdicts(judged) and not judged.is_misread
        assert any("friction" in finding for finding in judged.tables["findings"]["finding"])

    def test_creep_is_no_stick(self, frame):
        creeping = frame.assign(**{"guide.slip_velocity": frame["guide.slip_velocity"] + 0.01})
        assert set(verdicts(judge(CASE, only(creeping, ".slip_velocity")))) == {MISSED}

    def test_millimetres_and_degrees(self, frame):
        frame = only(frame, *POSITIONS, *VELOCITIES, ".effort")
        scale = [
            1 if name == "t" else 180 / np.pi if name.endswith((".angle", ".omega")) else 1e3
            for name in frame
        ]
        wrong = judge(CASE, frame * scale)
        assert (
            wrong.is_misread
            and any("deg" in hint for hint in wrong.hints)
            and any("mm" in hint for hint in wrong.hints)
        )
        right = judge(CASE, frame * scale, units=parse_units("mm,deg"))
        assert right.error < 1e-12 and not right.hints

    @pytest.mark.parametrize(("step", "word"), [(1, "late"), (-1, "early")])
    def test_a_step_off(self, frame, step, word):
        shifted = only(frame, *POSITIONS).shift(step).ffill().bfill().assign(t=frame["t"])
        judged = judge(CASE, shifted)
        [(hint, columns)] = judged.hints.items()
        assert word in hint and "slider.x" in columns and not judged.is_misread
        assert judged.error == pytest.approx(0.01 * frame["bar.vx"].abs().max(), rel=0.1)

    def test_a_reversed_sign(self, frame):
        frame = only(frame, *POSITIONS, ".effort")
        frame = frame.assign(**{"motor.effort": -frame["motor.effort"]})
        judged = judge(CASE, frame)
        assert (
            judged.is_misread
            and list(judged.hints.values()) == [["motor.effort"]]
            and judged.error < 1e-12
        )
        assert not judge(CASE, frame, {"motor.effort": "-motor.effort"}).hints

    def test_another_origin(self, frame):
        judged = judge(
            CASE, only(frame, "slider.x").assign(**{"slider.x": frame["slider.x"] - 0.25})
        )
        assert judged.is_misread and judged.error == pytest.approx(0.25)

    def test_energy_velocities_and_constraints_that_do_not_fit(self, frame):
        summary = (
            judge(CASE, frame.assign(**{"motor.effort": 1.1 * frame["motor.effort"]}))
            .tables["summary"]
            .loc[0]
        )
        assert summary["energy_error"] > 3 * summary["energy_uncertainty"]
        states = only(frame, *POSITIONS, *VELOCITIES)
        faster = states.assign(
            **{"slider.vx": 1.2 * frame["slider.vx"], "bar.vx": 1.2 * frame["bar.vx"]}
        )
        assert any(
            "velocities" in finding for finding in judge(CASE, faster).tables["findings"]["finding"]
        )
        off = only(frame, *POSITIONS).assign(**{"slider.y": frame["slider.y"] + 1e-3 * frame["t"]})
        assert judge(CASE, off).tables["summary"].at[0, "position_drift"] == pytest.approx(
            0.024 * np.sqrt(2), rel=0.01
        )

    def test_what_a_table_does_not_cover_is_not_counted(self, frame):
        late = judge(CASE, frame[frame["t"] >= 19])
        assert not late.is_complete and verdicts(late) == [FOUND]
        assert (
            late.tables["jumps"]["event_time"].min() >= 19
            and late.tables["jumps"]["resolved"].all()
        )

    def test_two_rows_are_a_table_and_half_a_one_is_not_complete(self, frame):
        judged, half = judge(CASE, frame[:2]), frame[frame["t"] <= 12]
        assert judged.error < 1e-12 and not judged.is_complete and not verdicts(judged)
        assert not judge(CASE, half).is_complete and judge(CASE, half, t_end=12).is_complete


class TestSampling:
    def test_short_stick_phases_are_not_charged(self):
        """At F0 = 4.1 N one of them takes 7.4 ms."""
        scene = load_scene(CASE, {"F0": 4.1})
        assert sorted(verdicts(judge(scene, true_table(F0=4.1)))) == [FOUND, FOUND, UNRESOLVED]
        assert set(verdicts(judge(scene, true_table(step=1e-3, F0=4.1)))) == {FOUND}

    def test_jumps_between_neighbouring_events_cannot_be_read(self):
        jumps = judge(CASE, true_table(step=0.1)).tables["jumps"]
        assert not jumps["resolved"].all() and not jumps["readable"].all()
        assert judge(CASE, true_table(step=2e-3)).tables["jumps"]["resolved"].all()


class TestTruths:
    def test_our_own_run_is_called_so(self):
        judged = judge("hard/peak-of-the-load", true_table(name="hard/peak-of-the-load"))
        assert judged.error < 1e-12 and rows_of(judged)["truth"]["is_own_run"]
        assert "not independent" in " ".join(judgement_section(judged).findings)

    def test_without_a_truth_the_table_is_held_against_itself(self):
        run = stiction.load_engine("reference").simulate(load_scene("painleve-rod"))
        judged = judge("painleve-rod", run)
        assert judged.error is None and judged.tables["findings"].empty
        assert not rows_of(judged)["truth"]["exists"] and rows_of(judged)["worst"] is None
        assert "no truth of painleve-rod" in judgement_section(judged).answer
        torn = run.to_frame()
        torn["rod.x"] += 0.3 * (torn["t"] > 0.03)
        assert len(judge("painleve-rod", torn).tables["findings"])

    def test_a_scene_without_friction(self):
        judged = judge("pendulum", true_table(name="pendulum"))
        assert (
            judged.error < 1e-12
            and judged.tables["stick-phases"].empty
            and list(judged.tables["jumps"]) == ["effort"]
        )


def test_events_of_a_table_without_modes_are_those_of_the_truth():
    judged = judge(CASE, only(true_table(two_sided=True), ".x", ".effort"))
    found, true = events_frame(judged.trajectory.events), events_frame(judged.truth.events)
    assert list(found["kind"]) == list(true["kind"])


@pytest.mark.parametrize("corners", [(), (".F2",), (".F1", ".F2", ".F3", ".F4")])
def test_a_mode_may_come_with_some_of_the_corner_forces(corners):
    """Both sides of the truth's events, among which corner events: nothing in them is inconsistent."""
    judged = judge(CASE, only(true_table(two_sided=True), ".x", ".mode", *corners))
    assert any(event.kind == "corner" for event in judged.trajectory.events)
    assert judged.tables["findings"].empty


@pytest.mark.parametrize(
    ("name", "held"),
    [
        ("slider-bar-case-1", {"bar.y", "bar.angle", "slider.y", "slider.angle"}),
        ("slider-crank", set()),
        ("four-bar", {"coupler-1.angle", "coupler-2.angle"}),
        ("pendulum", set()),
        ("block-on-incline", {"slider.angle"}),
        ("coulomb-oscillator", {"slider.y", "slider.angle"}),
    ],
)
def test_coordinates_that_no_force_moves(name, held):
    """Those of guides and drives, and of the couplers of parallelograms, which do not turn; none where all of the motion is prescribed."""
    scene = load_scene(name)
    assert prescribed(scene, ground_truth(scene)) == held


@pytest.mark.parametrize(
    ("column", "factor"),
    [
        ("slider.ax", 1.05),
        ("slider.ax", 0.9),
        ("guide.normal_force", 1.1),
        ("guide.friction", -1.0),
    ],
)
def test_an_acceleration_or_force_that_is_off_is_named_among_the_findings(column, factor):
    """A truth whose one column is some per cent too large; the truth itself has none such."""
    scene = load_scene("slider-bar-case-1", {"t_end": 8})
    t = np.linspace(0, 8, 801)
    true = {"t": t, **ground_truth(scene)(t)}

    def off(table):
        return rows_of(judge(scene, pd.DataFrame(table)))["coarse"]

    assert not off(true)
    wrong = judge(scene, pd.DataFrame({**true, column: factor * true[column]}))
    [found] = rows_of(wrong)["coarse"]
    assert found["row"]["column"] == column and not found["others"]
    assert 0.01 < found["part"] <= abs(factor - 1)
    assert any(line.startswith(column) for line in judgement_section(wrong).findings)


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize(
    "change",
    [
        lambda frame: frame,
        lambda frame: only(frame, *POSITIONS),
        lambda frame: only(frame, "slider.x"),
        lambda frame: frame.assign(
            **{"guide.F1": 1.2 * frame["guide.F1"], "slider.x": frame["slider.x"] + 1e-4}
        ),
    ],
)
def test_long_tables_are_judged_like_short_ones(monkeypatch, two_sided, change):
    """The same table as a whole and in parts of some hundred rows, whose columns are in files."""
    from stiction.comparisons.judge import consistency, judgement, table_trajectory
    from stiction.comparisons.measures import accuracy, result_errors
    from stiction.reference_impl import energies
    from stiction.scenes import result_table, table_blocks

    frame = change(true_table(two_sided=two_sided))
    whole = judge(CASE, frame)
    for module in (consistency, table_trajectory, accuracy, result_errors, energies):
        monkeypatch.setattr(module, "AT_ONCE", 300)
    monkeypatch.setattr(judgement, "SOLVED", 250)
    monkeypatch.setattr(result_table, "FILE_THRESHOLD_BYTES", 0)
    monkeypatch.setattr(table_blocks, "BLOCK_ROWS", 400)
    shares = []
    parts = judge(CASE, frame, tell=shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0
    for name in ("errors", "summary", "stick-phases", "jumps"):
        pd.testing.assert_frame_equal(parts.tables[name], whole.tables[name], rtol=1e-3, atol=1e-9)
    assert len(parts.tables["findings"]) == len(whole.tables["findings"])
    words = [text.split(" at t = ")[0] for text in whole.tables["findings"]["finding"]]
    assert [text.split(" at t = ")[0] for text in parts.tables["findings"]["finding"]] == words


class TestWords:
    """Numbers of the text are cells of the tables, and what it names is there."""

    @pytest.mark.parametrize(
        "change",
        [
            lambda frame: frame,
            lambda frame: only(frame, *POSITIONS),
            lambda frame: frame[frame["t"] >= 19],
            lambda frame: frame.assign(**{"slider.ax": 1.05 * frame["slider.ax"]}),
            lambda frame: frame.assign(**{"slider.x": frame["slider.x"] + 1e-3 * frame["t"]}),
            lambda frame: (1e3 * only(frame, "slider.x", "bar.y")).assign(t=frame["t"]),
            lambda frame: only(frame, ".effort"),
        ],
    )
    def test_numbers_are_those_of_the_tables(self, frame, change):
        judged = judge(CASE, change(frame))
        section = judgement_section(judged)
        assert not wrongly_written(section, Results((), {}, judged.tables))
        assert section.answer and all(each.caption for each in (*section.tables, *section.figures))
        rows, errors = rows_of(judged), judged.tables["errors"]
        assert rows["worst"]["column"] in section.answer
        phases = judged.tables["stick-phases"]["verdict"]
        assert rows["stick_phases"]["found"] == (phases == FOUND).sum()
        assert rows["misread"] == list(errors.loc[errors["is_input"], "column"])
        for one in rows["jumps"]:
            assert (one["read"], one["unit"]) == (judged.tables["jumps"]["resolved"].sum(), "N m")

    def test_the_largest_error_of_positions_is_a_bound(self, frame):
        """A true table is off by no more than the truth's uncertainty of its least known position."""
        judged = judge(CASE, frame)
        rows = rows_of(judged)
        metres = judged.in_metres("error") + judged.in_metres("uncertainty")
        assert rows["worst"]["column"] == judged.tables["errors"].at[metres.idxmax(), "column"]
        assert not rows["worst_is_certain"] and " at t = " not in judgement_section(judged).answer
        off = judge(CASE, frame.assign(**{"slider.x": frame["slider.x"] + 1e-3 * frame["t"]}))
        rows = rows_of(off)
        assert rows["worst"]["column"] == "slider.x" and rows["worst_is_certain"]
        assert float(rows["worst"]["error"]) == pytest.approx(0.024, rel=1e-6)
        assert float(rows["worst"]["error_time"]) == 24.0

    def test_columns_that_are_right_beside_others_in_another_unit_are_named(self, frame):
        """Millimetres of one column: an option for all columns would make the others wrong."""
        frame = only(frame, *POSITIONS)
        rows = rows_of(judge(CASE, frame.assign(**{"slider.x": 1e3 * frame["slider.x"]})))
        [hint] = rows["hints"]
        assert hint["columns"] == rows["misread"] == ["slider.x"]
        assert hint["right"] == ["bar.x", "bar.y", "slider.y"]
        [hint] = rows_of(judge(CASE, frame.assign(**{"slider.x": -frame["slider.x"]})))["hints"]
        assert hint["columns"] == ["slider.x"] and not hint["right"]  # a sign is that of a column

    def test_what_is_not_judged_is_named(self, frame):
        rows = rows_of(judge(CASE, frame.assign(nonsense=1.0)[["t", "bar.angle"]]))
        lacks = rows["not_judged"]
        assert lacks["stick_phases"] and lacks["jumps"] and lacks["drift"]
        assert "motor.effort" in lacks["energy"] and "bar.angle" not in lacks["energy"]
        rows = rows_of(judge(CASE, frame.assign(mine=1.0), {"mine": ""}))
        assert not any(rows["not_judged"].values()) and not rows["unknown"]

    def test_a_printed_judgement_has_its_numbers(self, frame):
        judged = judge(CASE, frame.assign(**{"slider.x": frame["slider.x"] + 1e-3 * frame["t"]}))
        text = str(judged)
        for part in (CASE, "slider.x", "15 of 15", judged.tables["findings"]["finding"][0]):
            assert part in text
        drift = judged.tables["summary"].at[0, "position_drift"]
        assert f"{drift:.6g}" in text and "nan\n" not in text.lower().split("largest errors")[0]
