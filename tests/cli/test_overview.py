"""The list of commands in the help: complete, and its examples are commands that exist."""

import shlex

import pytest
import typer
from conftest import invoke

from stiction.cli.app import app
from stiction.cli.overview import OVERVIEW

LISTED = {name: about for group in OVERVIEW.values() for name, about in group.items()}


def test_every_command_is_listed_once():
    root = typer.main.get_command(app)
    names = [name for group in OVERVIEW.values() for name in group]
    assert sorted(names) == sorted(root.list_commands(None))


@pytest.mark.parametrize("name", LISTED)
def test_an_example_is_of_its_command_and_has_only_known_options(name, in_this_process):
    words = shlex.split(LISTED[name].example)
    assert words[0] == name
    shown = invoke(*words, "--help").stdout
    options = [word for word in words if word.startswith("--")]
    assert all(option in shown for option in options)


def test_the_help_shows_groups_and_examples(in_this_process):
    shown = " ".join(invoke("--help").stdout.split())
    assert all(f"{group}:" in shown for group in OVERVIEW)
    assert all(f"stiction {about.example}" in shown for about in LISTED.values())
