"""Pictures show what the numbers say: parts that hold together are drawn together, corners have the numbers of their forces."""

import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from matplotlib.patches import FancyArrowPatch, Polygon
from PIL import Image
from typer import BadParameter
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.cli.pictures import write_pictures
from stiction.engines import load_engine
from stiction.scenes import catalogue, load_scene, scene_from_dict
from stiction.scenes.columns import label_of, unit_of, words_of
from stiction.scenes.model import Revolute
from stiction.scenes.pictures import animation
from stiction.scenes.pictures.geometry import (
    corners,
    displacement,
    poses_at,
    poses_at_start,
    view_of,
)
from stiction.scenes.pictures.mechanism import _legend
from stiction.scenes.pictures.parts import Stroke, parts

CASE = "slider-bar-case-1"


@pytest.fixture(scope="module")
def run(compiled):
    return load_engine("reference").simulate(load_scene(CASE), t_end=9)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(animation, "MIN_FRAMES", 5)
    monkeypatch.setattr(animation, "MAX_FRAMES", 5)
    return tmp_path


class TestGeometry:
    @pytest.mark.parametrize("name", [CASE, "elliptic-trammel", "slider-on-moving-guide"])
    def test_what_is_joined_is_drawn_together(self, name, compiled):
        """Pins at every output time, and sliders at their displacement along a guide that may move."""
        scene = load_scene(name)
        trajectory = load_engine("reference").simulate(scene, t_end=2, rtol=1e-9)
        for row in range(0, len(trajectory.t), 20):
            poses = poses_at(scene, trajectory, row)
            for joint in scene.joints.values():
                if isinstance(joint, Revolute):
                    first, second = (
                        poses[body].place(point) for body, point in zip(joint.bodies, joint.points)
                    )
                    assert np.allclose(first, second, atol=1e-6)
            for guide, element in scene.guides.items():
                assert displacement(element, poses) == pytest.approx(
                    trajectory[f"{guide}.displacement"][row], abs=1e-9
                )

    @pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 2, 3.0])
    def test_corners_are_where_their_forces_act(self, angle):
        """Lower is the side from which a force pushes along the normal, the direction turned by +90 degrees; front is where it points to."""
        direction = [np.cos(angle), np.sin(angle)]
        scene = scene_from_dict(
            {
                "bodies": {"box": {"mass": 1, "inertia": 1, "angle": angle, "position": [3, 4]}},
                "joints": {
                    "guide": {
                        "type": "translational",
                        "slider": "box",
                        "direction": direction,
                        "point": [3, 4],
                        "angle": angle,
                        "length": 2,
                        "width": 1,
                    }
                },
            }
        )
        normal = np.array([-direction[1], direction[0]])
        found = corners(scene.guides["guide"], poses_at_start(scene), (2, 1)) - np.array([3, 4])
        assert np.allclose(found @ direction, [-1, 1, 1, -1]) and np.allclose(
            found @ normal, [-0.5, -0.5, 0.5, 0.5]
        )

    def test_a_view_holds_the_whole_motion(self, run):
        scene = load_scene(CASE)
        view = view_of(scene, [poses_at(scene, run, row) for row in range(len(run.t))])
        tip = run["bar.x"] + np.cos(run["bar.angle"]), run["bar.y"] + np.sin(run["bar.angle"])
        for (low, high), values in zip((view.x, view.y), tip):
            assert low < values.min() and values.max() < high
        assert (
            view.reach["guide"][0] < run["guide.displacement"].min() - 0.3
            and run["guide.displacement"].max() + 0.3 < view.reach["guide"][1]
        )


class TestDrawing:
    @pytest.mark.parametrize(
        "name",
        [
            *(
                name
                for name in catalogue()
                if not name.endswith(("-mus-equals-mu", "-frictionless"))
            ),
            "hard/three-guides-at-rest",
        ],
    )
    def test_every_scene_can_be_drawn(self, name):
        """Those that differ in coefficients alone once."""
        assert ElementTree.fromstring(load_scene(name).draw().svg()).tag.endswith("svg")

    def test_same_scene_same_bytes(self, folder):
        for ending in ("svg", "pdf", "png"):
            for name in ("a", "b"):
                load_scene(CASE).draw().write(folder / f"{name}.{ending}")
            assert (folder / f"a.{ending}").read_bytes() == (folder / f"b.{ending}").read_bytes()

    def test_damper_body_alone_and_drive_along_an_axis(self):
        """What no scene of the catalogue has at once; a body of its own is no point without size."""
        scene = scene_from_dict(
            {
                "bodies": {
                    "a": {"mass": 1, "inertia": 1, "position": [1, 0]},
                    "b": {"mass": 1, "inertia": 1},
                },
                "springs": {
                    "damper": {
                        "type": "linear",
                        "bodies": ["a", "ground"],
                        "stiffness": 1,
                        "damping": 2,
                    }
                },
                "drives": {
                    "lift": {
                        "type": "distance",
                        "bodies": ["b", "ground"],
                        "axis": [0, 1],
                        "law": {"type": "linear", "rate": 1},
                    }
                },
                "forces": {
                    "push": {
                        "type": "force",
                        "body": "a",
                        "direction": [0, -1],
                        "law": {"type": "constant", "value": -2},
                    }
                },
            }
        )
        drawn = scene.draw().axes[0].patches
        assert [type(patch) for patch in drawn] == [Polygon] * 2 + [
            FancyArrowPatch
        ] * 2  # two bodies alone, drive, force
        (begin, end), (low, high) = (
            [np.asarray(point) for point in arrow._posA_posB] for arrow in drawn[2:]
        )
        assert (
            begin @ [1, 0] == end @ [1, 0] == 0 and end[1] > begin[1]
        )  # the drive, which is at its origin, along its axis
        assert (
            np.allclose(low, [1, 0]) and high[1] > 0 == high[0] - 1
        )  # -2 N along (0, -1) push upwards

    def test_a_spring_without_length_does_not_pin_its_body_to_the_ground(self):
        """The spring of the slider-bar is at rest at t = 0: its anchor, where the slider's pin is, once looked like that of a pin on the ground."""
        scene = load_scene(CASE)
        looks = [
            part.look
            for part in parts(scene, view_of(scene, [poses_at_start(scene)]))
            if isinstance(part, Stroke)
        ]
        assert "support" not in looks and looks.count("spring anchor") == 2
        pendulum = scene_from_dict(
            {
                "bodies": {"bob": {"mass": 1, "inertia": 1}},
                "joints": {
                    "pin": {
                        "type": "revolute",
                        "bodies": ["bob", "ground"],
                        "points": [[0, 1], [0, 1]],
                    }
                },
            }
        )
        assert "support" in [
            part.look
            for part in parts(pendulum, view_of(pendulum, [poses_at_start(pendulum)]))
            if isinstance(part, Stroke)
        ]

    def test_a_slot_lies_above_the_slider_that_has_it(self):
        """Whatever the order in the file: the slot of a yoke once lay below the yoke's box."""
        body, guide = (
            {"mass": 1, "inertia": 1},
            {"type": "translational", "length": 0.1, "width": 0.1},
        )
        slot, rail = (
            {**guide, "slider": "block", "guide": "yoke", "direction": [0, 1]},
            {**guide, "slider": "yoke", "length": 0.5, "width": 0.3},
        )
        for joints in ({"slot": slot, "rail": rail}, {"rail": rail, "slot": slot}):
            scene = scene_from_dict({"bodies": {"block": body, "yoke": body}, "joints": joints})
            drawn = [
                (part.look, part.at[0])
                for part in parts(scene, view_of(scene, [poses_at_start(scene)]))
                if isinstance(part, Stroke)
            ]
            order = [
                drawn.index(part)
                for part in (
                    ("surface", "ground"),
                    ("slider", "yoke"),
                    ("surface", "yoke"),
                    ("slider", "block"),
                )
            ]
            assert order == sorted(order)

    @pytest.mark.parametrize("direction", [[1, 0], [-1, 0], [0, 1], [0, -1]])
    @pytest.mark.parametrize(
        "law",
        [
            {"type": "constant", "value": -2},
            {"type": "sine", "amplitude": 3, "frequency": 2, "phase": 4},
        ],
    )
    def test_no_arrow_is_cut_off(self, direction, law):
        """A load, and a drive at the origin of its axis."""
        box = {"mass": 1, "inertia": 1}
        axes = (
            scene_from_dict(
                {
                    "bodies": {"box": box, "other": {**box, "position": [2, 1]}},
                    "forces": {
                        "pull": {"type": "force", "body": "box", "direction": direction, "law": law}
                    },
                    "drives": {
                        "lift": {
                            "type": "distance",
                            "bodies": ["other", "ground"],
                            "points": [[0, 0], [2, 1]],
                            "axis": direction,
                            "law": {"type": "linear", "rate": 1},
                        }
                    },
                }
            )
            .draw()
            .axes[0]
        )
        arrows = [arrow for arrow in axes.patches if isinstance(arrow, FancyArrowPatch)]
        tips = np.array([point for arrow in arrows for point in arrow._posA_posB])
        assert len(arrows) == 2 and all(
            low < values.min() and values.max() < high
            for values, (low, high) in zip(tips.T, (axes.get_xlim(), axes.get_ylim()))
        )

    def test_text_of_the_user_is_no_formula(self, folder):
        (folder / "a$\\b$.toml").write_text(
            'title = "$x^$"\n[bodies.ball]\nmass = 1\ninertia = 1\n'
        )
        scene = load_scene("a$\\b$.toml")
        scene.draw().write("drawn.svg")
        run = load_engine("reference").simulate(scene, t_end=0.1)
        run.plot().write("run.svg")
        assert run.animate("run.gif")


class TestEvolution:
    def test_a_panel_a_column(self, run):
        picture = run.plot("slider.x", "motor.effort")
        labels = [" ".join(ax.get_ylabel().split()) for ax in picture.axes]
        assert labels == ["position $x$ of slider [m]", "torque $M$ of motor [N m]"]
        assert run.plot().axes[-1].get_ylabel() == "driving effort [N m]"
        [words] = run.plot().axes[-1].get_legend().get_texts()
        assert words.get_text() == "torque $M$ of motor"
        assert picture._repr_png_().startswith(b"\x89PNG")
        with pytest.raises(KeyError, match="slider.z"):
            run.plot("slider.z")

    def test_jumps_are_vertical(self, run):
        [line] = run.plot("guide.friction").axes[0].lines
        jump = next(event for event in run.events if event.kind == "reversal")
        at = line.get_xdata() == jump.time
        assert (
            np.ptp(line.get_ydata()[at]) == pytest.approx(abs(jump.jump("guide.friction")))
            and abs(jump.jump("guide.friction")) > 0.5
        )


class TestChosenColumns:
    def test_labels_stay_within_their_panels(self, run):
        names = ["motor.effort", "guide.normal_force", "guide.slip_velocity", "guide.friction"]
        picture = run.plot(*names, against=[run])
        picture.draw_without_rendering()
        boxes = [ax.yaxis.label.get_window_extent() for ax in picture.axes]
        assert not any(
            one.overlaps(other) for number, one in enumerate(boxes) for other in boxes[:number]
        )
        assert [ax.get_ylabel().replace("\n", " ").partition(" [")[0] for ax in picture.axes] == [
            label_of(name, run.mechanism).partition(" [")[0] for name in names
        ]
        for ax in picture.axes:
            # equal runs lie on each other: the upper one lets the lower one through
            below, above = ax.lines
            assert (
                below.get_linestyle() == "-"
                and above.get_linestyle() != "-"
                and below.get_color() != above.get_color()
            )


class TestFilm:
    def test_gif_has_its_frames(self, run, folder):
        assert run.animate("run.gif") == 5 == Image.open(folder / "run.gif").n_frames

    def test_page_has_the_motion_and_the_forces(self, run, folder):
        run.animate(folder / "run.html")
        content = json.loads(
            re.search(r'id="film-data">(.*?)</script>', (folder / "run.html").read_text(), re.S)[1]
        )
        assert set(content["columns"]) >= {
            "bar.x",
            "bar.angle",
            "slider.x",
            "guide.F1",
            "guide.F4",
            "load load",
        }
        _, rows, low, step, _ = content["block"]["columns"][content["columns"]["slider.x"]]
        shown = run.to_frame(events=True, interpolated=True)["slider.x"]
        assert rows == len(shown) and (low, low + step * (2**16 - 2)) == pytest.approx(
            (shown.min(), shown.max()), rel=1e-9
        )
        assert content["largest"] == max(run[f"guide.F{i}"].max() for i in (1, 2, 3, 4))
        assert [part["text"] for part in content["mechanism"]["parts"] if part["kind"] == "label"][
            :4
        ] == ["1", "2", "3", "4"]

    def test_without_ffmpeg_mp4_is_refused(self, run, monkeypatch):
        monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
        with pytest.raises(ValueError, match="ffmpeg"):
            run.animate("run.mp4")

    def test_a_run_from_a_file_has_no_mechanism(self, run):
        stored = replace(run, mechanism=None)
        with pytest.raises(ValueError, match="mechanism: found None"):
            stored.animate("run.gif")
        with pytest.raises(BadParameter) as refused:
            write_pictures(stored, None, Path("run.gif"))
        assert refused.value.param_hint == "--animate"
        assert "<svg" not in stored._repr_html_() and "end state" in stored._repr_html_()


class TestNotebook:
    def test_titles_are_text(self):
        scene = load_scene(CASE, {"title": "<script>alert(1)</script>"})
        assert "<script>" not in scene._repr_html_() and "&lt;script&gt;" in scene._repr_html_()


class TestCommands:
    def test_draw_and_run(self, folder, in_this_process):
        assert (
            CliRunner().invoke(app, ["draw", CASE, "-o", "scene.svg", "--set", "L=3"]).exit_code
            == 0
        )
        ended = CliRunner().invoke(
            app, ["run", CASE, "--t-end", "1", "--plot", "run.pdf", "--animate", "run.gif"]
        )
        assert ended.exit_code == 0, ended.output
        assert sorted(path.name for path in folder.iterdir()) == ["run.gif", "run.pdf", "scene.svg"]

    def test_a_run_that_stops_is_drawn_up_to_there(self, folder, in_this_process):
        ended = CliRunner().invoke(app, ["run", "uniqueness-lost", "--plot", "run.png"])
        assert ended.exit_code == 1 and (Path("run.png").exists() or "no motion" in ended.output)


def test_columns_of_a_panel_have_the_unit_of_its_axis():
    """Guides and pins have columns of the same names, in different units."""
    scene = load_scene("slider-crank-dry-pins")
    run = load_engine("reference").simulate(scene, t_end=0.05)
    units = {words_of(column, scene): unit_of(column, scene) for column in run.columns}
    shown = 0
    for axes in run.plot().axes:
        for text in axes.get_legend().get_texts():
            assert f"[{units[text.get_text()]}]" in axes.get_ylabel()
            shown += 1
    assert shown >= 3


def test_a_pin_with_friction_looks_like_one():
    """Shaded, and named by itself in the legend; a pin that turns freely, or with a bound of zero, is white."""
    scene = load_scene("slider-crank-dry-pins", {"tau_pin": 0.0})
    view = view_of(scene, [poses_at_start(scene)])
    looks = [part.look for part in parts(scene, view) if isinstance(part, Stroke)]
    assert looks.count("dry pin") == 2 and looks.count("pin") == 1
    labels = [handle.get_label() for handle in _legend(scene)]
    assert "pin" in labels and "dry pin: pivot, crankpin" in labels


def test_a_clearance_is_drawn_as_a_gap():
    """The surfaces are half the width and the clearance away from the line, the slider keeps its size."""
    scene = load_scene("slider-bar-case-1", {"guide.clearance": 0.05})
    drawn = list(parts(scene, view_of(scene, [poses_at_start(scene)])))
    heights = {
        look: sorted(
            {float(y) for part in drawn if part_look(part) == look for y in part.points[:, 1]}
        )
        for look in ("surface", "slider")
    }
    assert heights["surface"] == pytest.approx([-0.3, 0.3])
    assert heights["slider"] == pytest.approx([-0.25, 0.25])


def part_look(part):
    """Return the look of a stroke; empty for other parts of a drawing."""
    return part.look if isinstance(part, Stroke) else ""
