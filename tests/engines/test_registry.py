"""The table of engines agrees with what else is known of an engine: its dependency, its folder, its page."""

import tomllib
from importlib import import_module
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from stiction.comparisons.bench.participants import participants
from stiction.engines import Engine, engine_names, load_engine, registry
from stiction.engines.registry import ENGINES, FILES, EngineEntry, UnknownEngine, own_methods

ROOT = Path(__file__).parents[2]
needs_checkout = pytest.mark.skipif(not (ROOT / "mkdocs.yml").exists(), reason="needs the checkout")


def project():
    """The project's table of pyproject.toml, and the packages that an installation has."""
    read = tomllib.loads((ROOT / "pyproject.toml").read_text())
    return read["project"], read["tool"]["setuptools"]["packages"]


def packages(requirements):
    return {Requirement(one).name for one in requirements}


def test_names_and_endings_are_given_once():
    names = [entry.name for entry in ENGINES]
    assert len(set(names)) == len(names)
    assert len({entry.ending for entry in FILES}) == len(FILES)
    assert engine_names()[: len(names)] == names


@pytest.mark.parametrize("entry", [*ENGINES, *FILES], ids=lambda entry: entry.address)
def test_an_address_is_that_of_an_engine(entry):
    module, _, attribute = entry.address.partition(":")
    assert issubclass(getattr(import_module(module), attribute), Engine)


@needs_checkout
@pytest.mark.parametrize("entry", ENGINES, ids=lambda entry: entry.name)
def test_an_entry_agrees_with_the_project(entry):
    about, folders = project()
    assert entry.address.partition(":")[0].rpartition(".")[0] in folders
    if entry.optional:
        # An extra may also name packages that the engine needs for some of its solvers.
        assert entry.package in packages(about["optional-dependencies"][entry.name])
    elif entry.package:
        assert entry.package in packages(about["dependencies"])
    if entry.package:
        pinned = packages(
            line
            for line in (ROOT / "constraints.txt").read_text().splitlines()
            if line and not line.startswith("#")
        )
        assert entry.package in pinned
    if entry.optional:
        assert packages(about["optional-dependencies"][entry.name]) <= pinned
    assert entry.own_method or (ROOT / "docs" / "engines" / f"{entry.name}.md").is_file()


@pytest.mark.parametrize("name", [".mine:Engine", "..mine:Engine", ":Engine", "mine:"])
def test_an_address_without_a_module_or_a_class_is_refused(name):
    with pytest.raises(UnknownEngine, match="expected .*module:Class"):
        load_engine(name)


def test_one_entry_makes_an_engine_known(monkeypatch):
    """A name and an address: it is loaded, it takes part, and it is no method of the suite's own."""
    added = EngineEntry("twin", "stiction.engines.reference.engine:ReferenceEngine")
    monkeypatch.setattr(registry, "ENGINES", (*ENGINES, added))
    assert isinstance(load_engine("twin"), Engine) and "twin" in engine_names()
    assert "twin" in {variant.engine for variant in participants()}
    assert "twin" not in own_methods()


def test_an_engine_that_the_system_runs_takes_part_where_it_is_named():
    [entry] = [entry for entry in ENGINES if entry.run_by_system]
    assert entry.name not in {variant.engine for variant in participants()}
    assert entry.name in {variant.engine for variant in participants([entry.name])}
