"""Which settings of an engine are its best: error against the engine's own time, one setting changed at a time.

Run it by ``python -m stiction.comparisons.studies.engine_settings [--engines A,B] [--scenes A,B] [--out FILE]``. What is tried is data:
``data/engine_settings.toml``. Every choice runs on every scene at every step. A choice is on the Pareto front of a scene if no other has both a
smaller error and a shorter time. What the adapters have as default is compared with the best: how much longer it takes than the fastest
choice that has no larger error.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.comparison import make
from stiction.comparisons.studies.work_precision import came_out, work_precision
from stiction.comparisons.variants import OWN_CPU, Variant
from stiction.scenes import Scene, load_scene

DEFAULT = "default"
ERROR = "position error [m]"


@dataclass(frozen=True)
class Study:
    """What is tried.

    Attributes
    ----------
    steps : tuple of float
        Seconds.
    scenes : tuple of str
    choices : Mapping[str, Mapping[str, Mapping[str, Sequence]]]
        By engine and fidelity the settings that matter, with the values that are tried; the others stay at their defaults.
    """

    steps: tuple[float, ...]
    scenes: tuple[str, ...]
    choices: Mapping[str, Mapping[str, Mapping[str, Sequence[Any]]]]

    def variants(self, engine: str) -> list[Variant]:
        """The default and every choice of an engine, at each fidelity; the label says what is changed."""
        found = []
        for fidelity, settings in self.choices[engine].items():
            default = Variant(f"{engine}, {fidelity}: {DEFAULT}", engine, "dt", self.steps, fidelity)
            found += [default, *(replace(default, label=f"{engine}, {fidelity}: {name}={value:g}", settings={name: value})
                                 for name, values in settings.items() for value in values)]
        return found


def load_study() -> Study:
    """That of ``data/engine_settings.toml``."""
    data = tomllib.loads((resources.files("stiction.comparisons") / "data" / "engine_settings.toml").read_text(encoding="utf-8"))
    return Study(tuple(data["steps"]), tuple(data["scenes"]), data["choices"])


def settings_table(scenes: Iterable[Scene], variants: Sequence[Variant], *, repeats: int = 3, **options: Any) -> pd.DataFrame:
    """One row per scene, choice and step as `stiction.comparisons.studies.work_precision.work_precision` makes them, with a column ``on the front``; options of `make`."""
    found = make([work_precision(scene, variants, repeats=repeats) for scene in scenes], **options)
    table = pd.concat([timed.table for timed in found], ignore_index=True)
    table["on the front"] = False
    for _, rows in table[came_out(table)].groupby(["scene", "engine", "fidelity"], sort=False):
        if ERROR in rows:
            table.loc[rows.index, "on the front"] = front(rows[ERROR].to_numpy(float), rows[OWN_CPU].to_numpy(float))
    return table


def front(error: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Which points no other dominates: at most the error and at most the cost, and less of one."""
    better = (error[None] <= error[:, None]) & (cost[None] <= cost[:, None]) & ((error[None] < error[:, None]) | (cost[None] < cost[:, None]))
    return ~better.any(axis=1)


def distance_of_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """How far the defaults are from the front: per scene, engine, fidelity and step the fastest choice that has no larger error, and the
    time of the default in units of its."""
    rows = []
    good = table[came_out(table) & table.get(ERROR, pd.Series(np.nan, table.index)).notna()]
    for (scene, engine, fidelity), group in good.groupby(["scene", "engine", "fidelity"], sort=False):
        for row in group[group["variant"].str.endswith(f": {DEFAULT}")].to_dict("records"):
            rivals = group[group[ERROR] <= row[ERROR] * (1 + 1e-9)]
            best = rivals.loc[rivals[OWN_CPU].idxmin()]
            rows.append({"scene": scene, "engine": engine, "fidelity": fidelity, "step": row["step"], ERROR: row[ERROR], OWN_CPU: row[OWN_CPU],
                         "fastest with no larger error": best["variant"].partition(": ")[2], "its step": best["step"], f"its {ERROR}": best[ERROR],
                         "time, of the fastest [-]": row[OWN_CPU] / best[OWN_CPU]})
    return pd.DataFrame(rows)


def main() -> None:
    """Print the study."""
    study = load_study()
    parser = argparse.ArgumentParser(description="Which settings of an engine are its best.")
    parser.add_argument("--engines", metavar="A,B", default=",".join(study.choices))
    parser.add_argument("--scenes", metavar="A,B", default=",".join(study.scenes))
    parser.add_argument("--out", metavar="FILE", help="write the whole table: .parquet")
    given = parser.parse_args()
    engines = given.engines.split(",")
    if unknown := set(engines) - study.choices.keys():
        parser.error(f"--engines: found {', '.join(sorted(unknown))}; expected some of {', '.join(study.choices)}")
    scenes = [load_scene(name) for name in given.scenes.split(",")]
    table = settings_table(scenes, [variant for engine in engines for variant in study.variants(engine)])
    if given.out:
        table.to_parquet(given.out)
    shown = table[["scene", "variant", "step", "status", "reason", ERROR, "cpu [s]", OWN_CPU, "on the front"]]
    print(shown.to_string(index=False, float_format="{:.3g}".format))
    print("\n" + distance_of_defaults(table).to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    main()
