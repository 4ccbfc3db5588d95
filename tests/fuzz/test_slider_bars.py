"""Random slider-bars against the independent solution, and what the truths do where they have no single answer."""

from dataclasses import replace

import numpy as np
import pytest

from fuzz import slider_bars
from fuzz.seeds import seed_or_fresh
from fuzz.slider_bars import (
    AGREES,
    REFERENCE_REFUSES,
    RIGHT,
    SAME_BREAKDOWN,
    T_END,
    TRUTH_REFUSES,
    UNDECIDED,
    difference,
    drawn,
    judge,
    slider_bar,
)
from stiction.comparisons.measures import scene_truth
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines.registry import load_engine
from stiction.reference_impl.friction.coulomb import equal_mobilization
from stiction.scenes import load_scene, vary
from stiction.scenes.trajectory import Breakdown
from stiction.truths import (
    NoMotion,
    NotThisMechanism,
    Tier,
    Undecided,
    incline_truth,
    oscillator_truth,
    slider_bar_truth,
)
from stiction.truths.reduced.piecewise_smooth import Collocation
from stiction.truths.reduced.slider_contact import Contact

SELF_LOCKING = {
    "F0": 2.173292141249958,
    "L": 1.5430006912566827,
    "w0": 5.0526693427481595,
    "m1": 0.22907042986989337,
    "m2": 0.32968651371907326,
    "k": 4.909342661734495,
    "Omega": 1.8145557747090157,
    "mu": 0.29516182946274194,
    "mus": 0.3963275262022262,
    "guide.length": 0.25859391629450895,
    "guide.width": 1.4875727629260793,
}


def follows(seed, scenes, rtols):
    """No scene is wrong, and most agree: else the draw tests refusals only."""
    wrong, agreeing = [], 0
    for i in scenes:
        for verdict in judge(drawn(seed, i), rtols):
            agreeing += verdict.outcome == AGREES
            if verdict.outcome not in RIGHT:
                wrong.append(f"slider_bars.drawn({seed}, {i}): {verdict}")
    assert not wrong, "\n".join(wrong)
    assert agreeing > 2 / 3 * len(scenes) * len(rtols)


def test_reference_follows_the_truth():
    follows(1, range(18), [1e-9])


@pytest.mark.long
@pytest.mark.parametrize("block", range(20))
def test_reference_follows_the_truth_20_000_times(block):
    follows(seed_or_fresh(None), range(block, 20_000, 20), [1e-9, 1e-12])


def test_a_run_of_another_scene_is_not_the_truth():
    """The comparison can fail: by a millionth of the friction, by an event less, by the kind of an event."""
    scene = load_scene("slider-bar-case-1")
    truth = slider_bar_truth(scene, T_END)
    run = load_engine("reference").simulate(
        vary(scene, {"mu": scene.joints["guide"].mu * (1 + 1e-6)}),
        t_end=T_END,
        rtol=1e-12,
        stabilization="projection",
    )
    assert 1e-8 < difference(run, truth)[0] < 1e-4
    moving = [event for event in truth.events if event.kind != "corner"]
    assert difference(run, replace(truth, events=tuple(moving[:-1])))[0] == np.inf
    other = replace(moving[0], kind="reversal")
    error, what = difference(run, replace(truth, events=(other, *moving[1:])))
    assert error == np.inf and what.startswith("event 1 of")


@pytest.mark.parametrize(
    "error, run_stops_at, outcome",
    [
        (NoMotion("several motions", 1.0), 1.0, SAME_BREAKDOWN),
        (NoMotion("several motions", 1.0), 0.5, REFERENCE_REFUSES),
        (NoMotion("several motions", 1.0), 2.0, TRUTH_REFUSES),
        (NoMotion("several motions", 1.0), None, TRUTH_REFUSES),
        (Undecided("grazes"), None, UNDECIDED),
    ],
)
def test_classes_of_refusals(error, run_stops_at, outcome, monkeypatch):
    run = load_engine("reference").simulate(load_scene("slider-bar-case-1"), t_end=0.1, rtol=1e-6)
    stopped = None if run_stops_at is None else Breakdown("several solutions", run_stops_at, "")
    monkeypatch.setattr(
        slider_bars, "_simulate", lambda scene, rtol, t_end: replace(run, breakdown=stopped)
    )

    def refuse(scene, t_end):
        raise error

    monkeypatch.setattr(slider_bars, "slider_bar_truth", refuse)
    assert judge(drawn(0, 0), [1e-9])[0].outcome == outcome


def test_the_truth_answers_or_refuses_by_type():
    """Chatter of corners at rest was undecided in 13 of 80 scenes."""
    refused = []
    for i in range(20):
        try:
            truth = slider_bar_truth(slider_bar(drawn(3, i)), T_END)
        except NoMotion as error:
            refused.append(error)
            continue
        resting = [
            event
            for event in truth.events
            if event.kind == "corner" and event.before["guide.mode"] == 0
        ]
        assert not resting
        assert truth.uncertainty["slider.x"] < 1e-11 and truth.uncertainty["event time"] < 1e-11
    assert len(refused) < 5 and all(0 <= error.time <= T_END for error in refused)


@pytest.mark.parametrize(
    ("name", "time"), [("a-millisecond", 5.62480), ("two-milliseconds", 22.47441)]
)
def test_a_break_away_of_a_millisecond_is_not_missed(name, time):
    scene = load_scene(f"hard/break-away-for-{name}")
    (event,) = [
        event for event in slider_bar_truth(scene, T_END).events if abs(event.time - time) < 1e-4
    ]
    assert event.kind == "slip"


def test_margins_are_those_of_full_static_friction():
    """mus max(|R|, |D_s|) - s P, from surface frictions mus N+ and mus N- and the moment they take."""
    contact, rng = Contact(0.6, 0.5, 0.1, 0.3), np.random.default_rng(5)
    R, M, P = rng.normal(size=(3, 50)) * [[20.0], [5.0], [8.0]]
    margins = np.max(contact.margins(R, M, P), axis=1)
    for s, margin in zip((1, -1), margins):
        n1, n2 = contact.corners(R, M, -0.3 * s)
        upper, lower = (np.maximum(sign * n1, 0) + np.maximum(sign * n2, 0) for sign in (-1, 1))
        np.testing.assert_allclose(
            0.3 * (n2 - n1) + 0.25 * -0.3 * s * (lower - upper), M, atol=1e-12
        )
        np.testing.assert_allclose(margin, 0.3 * (lower + upper) - s * P, atol=1e-12)


def test_mobilization_is_the_smallest_that_carries_the_friction():
    """phi N(phi) = friction, and less of it carries less; also where a wide guide's N falls with phi."""
    rng = np.random.default_rng(6)
    for width in (0.0, 0.5, 3.0):
        contact = Contact(0.6, width, 0.1, 0.3)
        R, M, friction = rng.normal(size=(3, 200)) * [[20.0], [5.0], [8.0]]
        phi = contact.mobilization(R, M, friction)

        def carried(part):
            n1, n2 = contact.corners(R, M, part * phi)
            return part * phi * (np.abs(n1) + np.abs(n2))

        np.testing.assert_allclose(carried(1.0), friction, rtol=1e-10)
        np.testing.assert_allclose(
            equal_mobilization(R, M, friction, 0.6, width), phi, rtol=1e-9
        )  # the reference's own split
        for part in np.linspace(0.0, 0.999, 50):
            assert np.all(np.abs(carried(part)) <= np.abs(friction) * (1 + 1e-10))


@pytest.mark.parametrize("depth", [1e-6, 1e-9, 1e-12])
def test_a_guard_that_dips_is_found_however_short(depth):
    """(x - 0.3)^2 - depth is negative for 2 sqrt(depth); of a pair of functions only where both are."""
    steps = Collocation(24)
    dip, low = (steps.nodes - 0.3) ** 2 - depth, np.full(24, -1.0)
    time, guard = steps.first_root(np.array([[low + 2, low], [dip, low]]), 2.0, -1e-12)
    assert guard == 1 and time == pytest.approx(1.3 - np.sqrt(depth), abs=1e-8)
    assert steps.first_root(np.array([[dip, -dip + 1e-3]]), 2.0, -1e-12) is None
    assert steps.first_root(np.array([[dip + 2 * depth]]), 2.0, -1e-12) is None


def test_self_locking_guides_are_refused_where_they_break_away():
    scene = slider_bar(SELF_LOCKING)
    with pytest.raises(NoMotion, match="slip or jam") as caught:
        slider_bar_truth(scene, T_END)
    time = caught.value.time
    rest = slider_bar_truth(scene, time - 1e-6)  # not before
    assert not rest.events
    c = rest(time - 1e-6)
    contact = Contact.of(scene.joints["guide"])
    margin = np.max(
        contact.margins(c["guide.normal_force"], c["guide.moment"], -c["guide.friction"]), axis=1
    ).min()
    assert 0 < margin < 1e-4  # it falls by some ten N/s


def test_other_truths_refuse_self_locking_guides_too():
    incline = load_scene("block-on-incline", {"incline": "deg(30)"})
    wide = {
        "guide.length": 0.1,
        "guide.width": 0.5,
    }  # mus = 0.3: mus * width = 0.15, full friction 0.45 |R| < tan(30 deg) |R|
    with pytest.raises(NoMotion, match="slip or jam") as caught:
        incline_truth(vary(incline, wide))
    assert caught.value.time == 0.0
    assert not incline_truth(
        vary(incline, {**wide, "incline": "deg(20)"})
    ).events  # rests: 0.45 > tan(20 deg)
    assert incline_truth(vary(incline, {**wide, "guide.width": 0.3}))(1.0)["guide.displacement"] > 1
    with pytest.raises(NoMotion, match="slip or jam"):
        oscillator_truth(
            vary(
                load_scene("coulomb-oscillator"),
                wide | {"P": 20.0, "guide.mu": 0.3, "guide.mus": 0.3},
            )
        )


def test_ground_truth_dispatches_on_types_only(fresh_truths, monkeypatch):
    scene = load_scene("slider-bar-case-1")

    def truth(error):
        def raises(scene, t_end):
            raise error

        monkeypatch.setattr(scene_truth, "INDEPENDENT", (raises,))
        return ground_truth(scene, 0.5)

    assert truth(NotThisMechanism("another")).tier == Tier.OWN_RUN
    undecided = truth(Undecided("two integrations"))
    assert undecided.tier == Tier.OWN_RUN and undecided.note == "two integrations"
    none = truth(NoMotion("several motions", 0.25))
    assert none.tier == Tier.NONE and "0.25" in none.note and none(0.1) == {}
    for bug in (
        ValueError("operands could not be broadcast"),
        np.linalg.LinAlgError("singular"),
        KeyError("x"),
    ):
        with pytest.raises(type(bug)):
            truth(bug)
