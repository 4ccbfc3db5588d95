"""Which settings of an engine are its best: error against the engine's own time, one setting changed at a time.

Run it by ``python -m comparisons.engine_settings [--engines A,B] [--scenes A,B] [--out FILE]``. Every choice runs on every scene at the steps
of `STEPS`; a choice is on the Pareto front of a scene if no other has both a smaller error and a shorter time. What the adapters have as
default is compared with the best: how much longer the fastest choice takes that has no larger error, at most, and by how much.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from comparisons.cost import came_out, work_precision
from comparisons.variants import OWN_CPU, Variant
from engines.isolation import Isolate, isolate
from scenes import Scene, load_scene

STEPS = (4e-3, 1e-3)
"""Seconds."""
SCENES = ("slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3", "elliptic-trammel", "slider-on-moving-guide", "hard/chatter")
CHOICES: Mapping[tuple[str, str], Mapping[str, Sequence[Any]]] = {
    ("pymunk", "joint"): {"iterations": (5, 10, 20, 50, 100, 200), "passes": (1, 2, 3, 5), "error_bias": (0.0, 0.1, 0.9)},
    ("pymunk", "contact"): {"iterations": (10, 30, 100, 200), "collision_slop": (1e-6, 1e-5, 1e-4), "collision_bias": (0.0, 0.9 ** 60, 0.5)},
    ("pybullet", "joint"): {"iterations": (2, 5, 10, 20, 50, 100), "passes": (1, 2, 3, 5), "erp": (0.2, 0.8, 1.0)},
    ("pybullet", "contact"): {"iterations": (50, 100, 200, 400), "contact_erp": (0.1, 0.2, 0.5), "contact_slop": (1e-6, 1e-5, 1e-4)},
    ("mujoco", "joint"): {"iterations": (2, 5, 10, 20, 50), "passes": (1, 2, 3, 5), "impedance": (0.9, 0.99, 0.9999)},
    ("exudyn", "joint"): {"spectral_radius": (0.0, 0.3, 0.6, 0.9), "newton_tolerance": (1e-7, 1e-8, 1e-9, 1e-10)},
    ("exudyn", "contact"): {"contact_stiffness": (1e6, 1e7, 1e8), "contact_damping": (5e3, 5e4, 5e5), "friction_zone": (1e-3, 1e-4, 1e-5)},
}
"""By engine and fidelity the settings that matter, with the values that are tried; the others stay at their defaults."""
DEFAULT = "default"
ERROR = "position error [m]"


def choices(engine: str, fidelity: str) -> list[Variant]:
    """The default and every choice of an engine, as variants; the label says what is changed."""
    found = [Variant(f"{engine}, {fidelity}: {DEFAULT}", engine, "dt", STEPS, fidelity)]
    return found + [replace(found[0], label=f"{engine}, {fidelity}: {name}={value:g}", settings={name: value})
                    for name, values in CHOICES[engine, fidelity].items() for value in values]


def settings_table(scenes: Iterable[Scene], engines: Iterable[str], *, repeats: int = 3, timeout_s: float = 120.0,
                   isolated: Isolate = isolate) -> pd.DataFrame:
    """One row per scene, choice and step as `comparisons.cost.work_precision` makes them, with a column ``on the front``."""
    variants = [variant for engine, fidelity in CHOICES if engine in set(engines) for variant in choices(engine, fidelity)]
    tables = [work_precision(scene, variants, repeats=repeats, timeout_s=timeout_s, isolated=isolated) for scene in scenes]
    table = pd.concat(tables, ignore_index=True)
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
    parser = argparse.ArgumentParser(description="Which settings of an engine are its best.")
    parser.add_argument("--engines", default=",".join(dict.fromkeys(engine for engine, _ in CHOICES)))
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--out", help="write the whole table: .parquet")
    given = parser.parse_args()
    table = settings_table([load_scene(name) for name in given.scenes.split(",")], given.engines.split(","))
    if given.out:
        table.to_parquet(given.out)
    shown = table[["scene", "variant", "step", "status", "reason", ERROR, "cpu [s]", OWN_CPU, "on the front"]]
    print(shown.to_string(index=False, float_format="{:.3g}".format))
    print("\n" + distance_of_defaults(table).to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    main()
