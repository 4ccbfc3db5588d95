"""Guides whose load passes zero, against closed forms.

One sine load on a mass in a guide, without weight, has the fixed ratio r = |u_t| / |u_n| of what friction must hold to what presses: the mass
sticks for ever if r <= mus, although capacity and pull vanish together at each zero of the load, and slips from the start if r > mus. While it
slips, between two zeros of the load, it has the acceleration c |sin(w t + phase)|, c = (sign u_t - mu |u_n| d) A / m, which integrates in closed
form; where it stops, it goes on at once or not until the load's ratio lets it, which it never does.
"""

from math import acos, copysign, cos, exp, floor, hypot, pi, sin, tan

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from reference_checks import simulate

from stiction.scenes import scene_from_dict

T_END = 7.0
RTOL = 1e-9
BOUND = 1e4 * RTOL
"""Some ten events and a hundred steps, each wrong by rtol of the mechanism's size, magnified by speeds over the time behind it."""


def pushed(tangential, normal, mu, mus, length, phase):
    """A mass of 1 kg in a guide under one sine load of 1 N and 1 rad/s."""
    shape = {"length": length, "width": 0.3 * length} if length else {}
    return scene_from_dict(
        {
            "t_end": T_END,
            "gravity": [0, 0],
            "bodies": {"mass": {"mass": 1, "inertia": 0.1}},
            "joints": {
                "guide": {"type": "translational", "slider": "mass", "mu": mu, "mus": mus, **shape}
            },
            "forces": {
                "load": {
                    "type": "force",
                    "body": "mass",
                    "direction": [tangential, normal],
                    "law": {"type": "sine", "amplitude": 1, "frequency": 1, "phase": phase},
                }
            },
        },
        "pushed mass",
    )


def displacement(tangential, normal, mu, mus, phase):
    """Of `pushed` at T_END, in closed form."""
    pull, press = tangential / hypot(tangential, normal), abs(normal) / hypot(tangential, normal)
    t, x, v = 0.0, 0.0, 0.0
    while t < T_END:
        wave = floor((t + phase) / pi + 1e-9)
        end, sign = min(T_END, (wave + 1) * pi - phase), 1 if wave % 2 == 0 else -1
        while t < end:
            if v == 0.0 and abs(pull) <= mus * press:
                t = end
                break
            direction = copysign(1, v if v != 0.0 else sign * pull)
            c = sign * pull - mu * press * direction

            def once(time):
                return -cos(time + phase - wave * pi)

            def twice(time):
                return -sin(time + phase - wave * pi)

            stop = end
            if c * direction < 0.0 and once(t) - v / c < once(end):
                stop = acos(v / c - once(t)) + wave * pi - phase
            x += v * (stop - t) + c * (twice(stop) - twice(t) - once(t) * (stop - t))
            v = v + c * (once(stop) - once(t)) if stop == end else 0.0
            t = stop
    return x


@settings(max_examples=60, deadline=None)
@given(
    angle=st.floats(0.02, 1.55),
    quadrant=st.integers(0, 3),
    mu=st.floats(0.1, 1.2),
    more=st.sampled_from([1.0, 1.4]),
    length=st.sampled_from([0.0, 0.5]),
    phase=st.one_of(st.sampled_from([0.0, pi]), st.floats(0.01, 6)),
)
@example(angle=1.1, quadrant=0, mu=0.4, more=1.5, length=0.0, phase=0.0)
@example(angle=1.1, quadrant=1, mu=0.6, more=1.0, length=0.5, phase=1.0)
@example(angle=0.3, quadrant=2, mu=0.4, more=1.0, length=0.5, phase=pi)
def test_mass_under_one_load(angle, quadrant, mu, more, length, phase):
    mus = more * mu  # below length/width, beyond which it may jam
    tangential, normal = (
        cos(angle) * (1, -1, -1, 1)[quadrant],
        sin(angle) * (1, 1, -1, -1)[quadrant],
    )
    assume(abs(abs(tangential) - mus * abs(normal)) >= 1e-6)
    run = simulate(pushed(tangential, normal, mu, mus, length, phase), rtol=RTOL)
    assert abs(run["mass.x"][-1] - displacement(tangential, normal, mu, mus, phase)) < BOUND
    if abs(tangential) < mus * abs(normal):
        assert not run.events and run["mass.x"][-1] == 0.0


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("phase", [0.0, 1.0, pi])
@pytest.mark.parametrize("length", [0.0, 0.5])
@pytest.mark.parametrize("angle", [1.2, -1.2, 0.7])
def test_rider_on_a_shaken_base_stays(angle, length, phase, rtol):
    """A slider in a guide on a base that a sine load shakes: its load is its inertia alone, of ratio 1/tan(angle), and zero where the base's is."""
    mus = 1.3 / abs(tan(angle))
    shape = {"length": length, "width": 0.3 * length} if length else {}
    scene = scene_from_dict(
        {
            "t_end": T_END,
            "gravity": [0, 0],
            "bodies": {
                "base": {"mass": 2, "inertia": 0.1},
                "rider": {"mass": 1, "inertia": 0.1, "angle": angle},
            },
            "joints": {
                "rail": {"type": "translational", "slider": "base"},
                "guide": {
                    "type": "translational",
                    "slider": "rider",
                    "guide": "base",
                    "direction": [cos(angle), sin(angle)],
                    "angle": angle,
                    "mu": mus / 1.4,
                    "mus": mus,
                    **shape,
                },
            },
            "forces": {
                "load": {
                    "type": "force",
                    "body": "base",
                    "direction": [1, 0],
                    "law": {"type": "sine", "amplitude": 1, "frequency": 1.3, "phase": phase},
                }
            },
        },
        "rider",
    )
    run = simulate(scene, rtol=rtol)
    assert not run.events
    # both are one body of 3 kg
    x = (sin(phase) + 1.3 * T_END * cos(phase) - sin(1.3 * T_END + phase)) / (3 * 1.3**2)
    assert abs(run["base.x"][-1] - x) < 1e4 * rtol and abs(run["rider.x"][-1] - x) < 1e4 * rtol


@pytest.mark.parametrize("length", [0.0, 0.5])
@pytest.mark.parametrize("sign", [1, -1])
def test_load_that_begins_later(sign, length):
    """Nothing presses nor pulls for 1 s, then a load grows by 1 N/s: a = (0.8 - 0.5 0.6)(t - 1) m/s^2 from there, x = 0.5/6 (t - 1)^3."""
    shape = {"length": length, "width": 0.3 * length} if length else {}
    scene = scene_from_dict(
        {
            "t_end": 3,
            "gravity": [0, 0],
            "bodies": {"mass": {"mass": 1, "inertia": 0.1}},
            "joints": {
                "guide": {"type": "translational", "slider": "mass", "mu": 0.5, "mus": 0.7, **shape}
            },
            "forces": {
                "load": {
                    "type": "force",
                    "body": "mass",
                    "direction": [0.8, 0.6],
                    "law": {"type": "table", "times": [0, 1, 3], "values": [0, 0, 2 * sign]},
                }
            },
        },
        "later",
    )
    run = simulate(scene, rtol=RTOL)
    assert abs(run["mass.x"][-1] - sign * 0.5 / 6 * 2**3) < BOUND


@settings(max_examples=30, deadline=None)
@given(
    w=st.floats(0.5, 4),
    start=st.floats(0.2, 1.5),
    inwards=st.floats(0.1, 0.9),
    mu=st.floats(0.01, 0.5),
    more=st.floats(1, 2),
    turn=st.sampled_from([1, -1]),
    length=st.sampled_from([0.0, 0.2]),
    rtol=st.sampled_from([1e-9, 1e-12]),
)
def test_slider_on_an_arm_that_turns(w, start, inwards, mu, more, turn, length, rtol):
    """Without weight only the Coriolis force 2 m w r' presses on the guide, so that speed, normal force and friction pass zero together.

    r'' = w^2 r - 2 mu w r', for either sign of r': r = A exp(p t) + B exp(q t), p, q = w (-mu +- sqrt(mu^2 + 1)). It turns round once if it
    starts inwards, slower than q r. At that instant all corners change their surface, which is part of the reversal.
    """
    p, q, t_end = w * ((mu**2 + 1) ** 0.5 - mu), -w * ((mu**2 + 1) ** 0.5 + mu), 6 / w
    v = inwards * q * start
    shape = {"length": length, "width": 0.5 * length} if length else {}
    scene = scene_from_dict(
        {
            "t_end": t_end,
            "gravity": [0, 0],
            "bodies": {
                "arm": {"mass": 3, "inertia": 1, "angular_velocity": turn * w},
                "slider": {
                    "mass": 1.3,
                    "inertia": 0.1,
                    "position": [start, 0],
                    "velocity": [v, turn * w * start],
                    "angular_velocity": turn * w,
                },
            },
            "joints": {
                "pivot": {"type": "revolute", "bodies": ["arm", "ground"]},
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "guide": "arm",
                    "direction": [1, 0],
                    "mu": mu,
                    "mus": more * mu,
                    **shape,
                },
            },
            "drives": {
                "motor": {
                    "type": "angle",
                    "bodies": ["arm", "ground"],
                    "law": {"type": "linear", "rate": turn * w},
                }
            },
        },
        "turning arm",
    )
    run = simulate(scene, rtol=rtol, stabilization="projection")
    A = (v - q * start) / (p - q)
    r = A * exp(p * t_end) + (start - A) * exp(q * t_end)
    assert abs(hypot(run["slider.x"][-1], run["slider.y"][-1]) - r) < 1e4 * rtol * max(r, start)
    assert [event.kind for event in run.events] == ["reversal"]
