"""A campaign that cannot be used is refused with every problem: the file, the key, what was found and expected."""

import pytest
from conftest import invoke

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.campaign import CampaignError, load_campaign

SMALL = """
scenes = ["slider-bar-case-1"]
[variants.reference]
engine = "reference"
rtol = [1e-9]
"""
CASE = '"slider-bar-case-1"'
DEPTH = """[depths.quick]
limit = 1
bracket = 1e-3
repeats = 1
ladder = 1
sensitivity = false
equal_error = false
settings = false
trajectories = "all"
"""


def steps(text: str) -> str:
    """The small campaign with other steps."""
    return SMALL.replace("rtol = [1e-9]", text)


@pytest.mark.parametrize(
    ("text", "culprits"),
    [
        ("scenes = ", ["file", "expected TOML"]),
        ("", ["scenes", "variants", "required"]),
        (SMALL + "[budget]\ntotl = 3\n", ["budget.totl", "did you mean 'total'"]),
        (
            SMALL.replace('"reference"\n', '"pymnk"\n'),
            ["variants.reference.engine", "pymnk", "did you mean 'pymunk'"],
        ),
        (SMALL.replace("case-1", "case-9"), ["scenes.0", "slider-bar-case-9", "did you mean"]),
        (
            SMALL.replace(CASE, '"pendulum", "pendulum"'),
            ["scenes.1", "one scene of the name pendulum"],
        ),
        (SMALL + "dt = [1e-3]\n", ["dt, rtol", "found 'dt and rtol'"]),
        (
            steps("rtol = [1e-9, 1e-6]"),
            ["variants.reference.rtol", "decrease: from coarse to fine"],
        ),
        (steps("iterations = [50, 2]"), ["increase"]),
        (steps("rtol = []"), ["variants.reference.rtol", "expected at least 1 number"]),
        (steps("cost = [1e-2]"), ["found 'none'"]),
        (steps("dt = [1e-2]\ncost = [1e-3, 1e-2]"), ["cost: found"]),
        (steps("dt = [1e-2]\nladder = [1]"), ["unknown key"]),
        (SMALL + "[budget]\nrun = -1\n", ["budget.run", "-1", "> 0"]),
        ('measure = ["colour"]\n' + SMALL, ["measure.0", "colour", "counter"]),
        (
            SMALL + 'fidelity = "jont"\n',
            ["variants.reference.fidelity", "jont", "did you mean 'joint'"],
        ),
        (
            SMALL + f'[check]\nscenes = [{CASE}]\nvariants = ["refrence"]\n',
            ["check.variants.0", "refrence", "did you mean 'reference'"],
        ),
        (
            SMALL + f"[check]\nscenes = []\nvariants = []\nevery = [{CASE}]\n",
            ["check.every.0", "slider-bar-case-1"],
        ),
        ("workers = 0\n" + SMALL.replace("case-1", "case-9"), ["workers", "scenes.0"]),
        (SMALL + DEPTH.replace("quick", "deep"), ["deep"]),
        (SMALL + DEPTH + "longest = 1\n", ["unknown key"]),
        # keys of older versions
        ("random = 400\n" + SMALL, ["random: found 400; unknown key"]),
        ("random_mechanisms = 40\n" + SMALL, ["random_mechanisms: found 40; unknown key"]),
        (SMALL + DEPTH.replace("limit = 1", "limit = 0"), ["limit: found 0"]),
        (SMALL + DEPTH + "runs = { dt = -1 }\n", ["runs.dt: found -1"]),
        (SMALL + DEPTH.replace("all", "some"), ["trajectories: found 'some'"]),
    ],
)
def test_bad_campaign(text, culprits, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text(text)
    ended = invoke("nightly", "bad.toml", exit_code=BAD_INPUT)
    assert ended.stdout == "" and len(ended.stderr.splitlines()) < 30, ended.output
    for culprit in ("bad.toml", *culprits):
        assert culprit in ended.stderr
    with pytest.raises(CampaignError):
        load_campaign("bad.toml")


def test_a_campaign_in_another_folder_names_scenes_of_the_catalogue_and_files_beside_it(tmp_path):
    """Hard ones too; the hint for a name that is wrong does not depend on the folder."""
    (tmp_path / "mine.toml").write_text('base = "pendulum"\n')
    scenes = '"pendulum", "hard/can-jam", "mine.toml"'
    (tmp_path / "a.toml").write_text(SMALL.replace(CASE, scenes))
    assert [scene.name for scene in load_campaign(tmp_path / "a.toml").scenes] == [
        "pendulum",
        "can-jam",
        "mine",
    ]
    (tmp_path / "a.toml").write_text(SMALL.replace("case-1", "case-9"))
    with pytest.raises(
        CampaignError, match="scenes.0: found 'slider-bar-case-9'.*did you mean 'slider-bar-case-"
    ):
        load_campaign(tmp_path / "a.toml")
