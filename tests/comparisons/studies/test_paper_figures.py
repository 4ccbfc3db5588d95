"""Figures of the paper: their numbers, what their captions mention, and mechanisms that look the same once."""

from made_up_runs import CASES, record

from stiction.comparisons.bench.results import Results
from stiction.comparisons.studies.motion import STUDY as MOTION
from stiction.comparisons.studies.paper_figures import STUDY
from stiction.reports.text import section_of
from stiction.scenes import load_scene
from stiction.truths import slider_bar_truth

SUBJECTS = ("velocity-acceleration", "corner-forces", "driving-moment")


def results_of(*cases, truths=CASES):
    """Records without trajectories, and the truths of some cases."""
    found = {case: slider_bar_truth(load_scene(case), 9.0) for case in truths if case in cases}
    return Results(
        tuple(record("reference", case, 1e-9, "failed", "made up") for case in cases), found, {}
    )


def test_each_case_has_the_figures_of_the_paper():
    results = results_of(*CASES)
    said, section = STUDY.presented(results), section_of(STUDY, results)
    # case 2 differs from case 1 in its load alone, case 3 has another bar
    assert [one["scene"] for one in said.rows["mechanisms"]] == [CASES[0], CASES[2]]
    assert [one["number"] for one in said.rows["series"]] == list(range(5, 14))
    assert [(one["scene"], one["subject"]) for one in said.rows["series"]] == [
        (case, subject) for case in CASES for subject in SUBJECTS
    ]
    pictures, charts = section.figures[:2], section.figures[2:]
    for picture, case in zip(pictures, (CASES[0], CASES[2]), strict=True):
        for name, value in load_scene(case).parameters.items():
            assert f"{name} = {value:g}" in picture.caption
    for chart, one in zip(charts, said.rows["series"], strict=True):
        title = load_scene(one["scene"]).title
        assert chart.name == f"fig{one['number']:02d}-{one['scene']}-{one['subject']}"
        assert title in chart.caption and f"Fig. {one['number']})" in chart.caption
        assert one["has_stick_phases"] == bool(chart.panels[0].shades)
    # case 1 sticks, as its stick threshold is above its load
    assert said.rows["series"][0]["has_stick_phases"]


def test_a_scene_that_the_paper_does_not_have_has_no_number():
    results = results_of("pendulum")
    said = STUDY.presented(results)
    assert said.is_empty
    # Its motion is shown instead, without a number.
    motion = MOTION.presented(results)
    assert "mechanism-pendulum" in [one.name for one in motion.figures]
    [mechanism] = motion.rows["mechanisms"]
    assert not mechanism["has_corners"]
    other = Results((), {}, {})
    assert STUDY.presented(other).is_empty and section_of(STUDY, other).is_empty
