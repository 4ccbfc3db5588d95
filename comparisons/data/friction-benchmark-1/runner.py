"""Runner of friction-benchmark 1: solves the scenes with your solver, and writes a submission.

Write your solver into `simulate`, describe it in ABOUT, and run

    python runner.py BENCHMARK SUBMISSION

with the folder of the benchmark and a folder to write. It needs Python 3.11 or later and nothing else.
"""

import csv
import json
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
SETTINGS = {"dt": 0.001}


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
    raise Declined("not implemented yet")


def write_table(file, columns):
    """Write the columns of a result to a CSV file, in full precision."""
    with open(file, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def as_toml(value):
    """Return a text, a number or a truth value in the notation of TOML, which for these is that of JSON."""
    return json.dumps(value, ensure_ascii=False)


def write_description(file, declined):
    """Write submission.toml; `declined` contains the reasons by scene."""
    command = " ".join(["python", *sys.argv])
    lines = [f"{key} = {as_toml(value)}" for key, value in {**ABOUT, "command": command}.items()]
    lines += ["", "[settings]", *(f"{key} = {as_toml(value)}" for key, value in SETTINGS.items())]
    lines += [
        "",
        "[declined]",
        *(f"{name} = {as_toml(reason)}" for name, reason in declined.items()),
    ]
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
            declined[name] = str(reason)
            # A table of an earlier run would contradict the reason.
            (submission / f"{name}.csv").unlink(missing_ok=True)
            print(f"{name}: declined: {reason}")
            continue
        write_table(submission / f"{name}.csv", columns)
        print(f"{name}: {len(columns['t'])} rows")
    write_description(submission / "submission.toml", declined)


if __name__ == "__main__":
    main()
