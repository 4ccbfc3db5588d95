"""Runner of friction-benchmark 1: solves the scenes with your solver, and writes a submission.

Write your solver into `simulate`, describe it in ABOUT and SETTINGS, and run

    python runner.py BENCHMARK SUBMISSION

with the folder of the benchmark and a folder to write. It needs Python 3.11 or later and nothing else. As it is
delivered, it solves the scene block-on-incline by a formula and declines all others.
"""

import csv
import json
import math
import re
import sys
from pathlib import Path

ABOUT = {
    "benchmark": "friction-benchmark 1",
    "who": "your name",
    "engine": "your solver",
    "version": "1.0",
    "fidelity": "joint",  # or "contact": see RULES.md
    "machine": "your machine",
}
SETTINGS = {"dt": 0.001}  # any names; values are numbers, texts, True or False


class Declined(Exception):
    """The solver cannot represent a scene; the message is the reason."""


def simulate(name, scene, step):
    """Solve one scene: replace this function.

    Parameters
    ----------
    name : str
        Name of the scene, such as "block-on-incline".
    scene : dict
        The mechanism, as in scene.json: scene["t_end"], scene["gravity"], scene["bodies"], scene["joints"],
        scene["drives"], scene["springs"], scene["forces"]. description.txt explains the numbers.
    step : float
        Largest distance of the rows, s. The step of your solver may be smaller.

    Returns
    -------
    dict of lists
        The columns of the table by name: "t", and one or more of those that description.txt lists, for example
        {"t": [0.0, 0.01, ..], "slider.x": [0.0, ..]}.

    Raises
    ------
    Declined
        If your solver cannot represent the scene.
    """
    if name != "block-on-incline":
        raise Declined("not implemented yet")
    guide = scene["joints"]["guide"]
    slider = scene["bodies"][guide["slider"]]
    # The weight along the guide, and the normal force; no corner lifts, so that the load of the friction is |normal|.
    direction_x, direction_y = guide["direction"]
    gravity_x, gravity_y = scene["gravity"]
    pull = slider["mass"] * (gravity_x * direction_x + gravity_y * direction_y)
    normal = -slider["mass"] * (gravity_y * direction_x - gravity_x * direction_y)
    # The slider is at rest at t = 0, and remains there unless the pull exceeds static friction.
    acceleration = 0.0
    if abs(pull) > guide["mus"] * abs(normal):
        friction = -math.copysign(guide["mu"] * abs(normal), pull)
        acceleration = (pull + friction) / slider["mass"]
    times = [row * step for row in range(round(scene["t_end"] / step) + 1)]
    distances = [acceleration * t**2 / 2 for t in times]
    x, y = slider["position"]
    return {
        "t": times,
        "slider.x": [x + direction_x * distance for distance in distances],
        "slider.y": [y + direction_y * distance for distance in distances],
    }


def write_table(file, columns):
    """Write the columns of a result to a CSV file, in full precision."""
    with open(file, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def toml_text(text):
    """Return a text in quotes, with the escapes of TOML: those of JSON, and one more for the character DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_line(key, value):
    """Return a line `key = value` of a TOML file; the value is a text, a number, true or false.

    A key with other characters than letters, digits, _ and - must be in quotes.
    """
    name = key if re.fullmatch("[A-Za-z0-9_-]+", key) else toml_text(key)
    if isinstance(value, str):
        return f"{name} = {toml_text(value)}"
    if isinstance(value, bool):
        return f"{name} = {str(value).lower()}"
    if isinstance(value, (int, float)):
        # As text, an infinite number is inf and an undefined one nan, in Python and in TOML.
        return f"{name} = {value}"
    sys.exit(f"{key}: found {value!r}; expected a text, a number, True or False")


def write_description(file, declined):
    """Write submission.toml; `declined` contains the reasons by scene."""
    command = " ".join(["python", *sys.argv])
    tables = {"": {**ABOUT, "command": command}, "settings": SETTINGS, "declined": declined}
    lines = []
    for title, table in tables.items():
        if title:
            lines += ["", f"[{title}]"]
        lines += [toml_line(key, value) for key, value in table.items()]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main():
    """Solve all scenes of the benchmark."""
    if len(sys.argv) != 3:
        sys.exit("usage: python runner.py BENCHMARK SUBMISSION")
    benchmark, submission = map(Path, sys.argv[1:])
    submission.mkdir(parents=True, exist_ok=True)
    declined = {}
    with open(benchmark / "scenes.csv", newline="", encoding="utf-8") as table:
        rows = list(csv.DictReader(table))
    for row in rows:
        name = row["scene"]
        text = (benchmark / "scenes" / name / "scene.json").read_text(encoding="utf-8")
        try:
            columns = simulate(name, json.loads(text)["scene"], float(row["max_step"]))
        except Declined as reason:
            declined[name] = str(reason) or "no reason stated"
            # A table of an earlier run would contradict the reason.
            (submission / f"{name}.csv").unlink(missing_ok=True)
            print(f"{name}: declined: {reason}")
            continue
        write_table(submission / f"{name}.csv", columns)
        print(f"{name}: {len(columns['t'])} rows")
    write_description(submission / "submission.toml", declined)


if __name__ == "__main__":
    main()
