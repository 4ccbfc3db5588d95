"""What Siconos says where it is not there: a line that names what brings it, and no traceback."""

import sys

import pytest
from conftest import LONGEST_REASON, invoke

from stiction.engines import EngineMissing, load_engine
from stiction.engines.registry import EngineBroken
from stiction.engines.siconos import engine as adapter


@pytest.fixture
def answered(tmp_path, monkeypatch):
    """A function that loads an engine whose version command is this one, and returns what it says."""

    def load(version, kind):
        declared = tmp_path / "siconos.toml"
        declared.write_text(
            f'name = "siconos"\ncommand = ["/bin/sh", "{{scene}}", "{{result}}", "{{dt}}"]\nversion = {version}\n'
        )
        monkeypatch.setattr(adapter, "DECLARATION", declared)
        with pytest.raises(EngineMissing, match="apt-get install python3-siconos") as caught:
            load_engine("siconos")
        assert type(caught.value) is kind
        return str(caught.value)

    return load


@pytest.mark.parametrize("command", [["./python-that-nobody-has"], ["/bin/sh", "-c", "exit 1"]])
def test_where_it_is_missing_it_says_what_brings_it(command, answered):
    answered(command, EngineMissing if command[0].startswith(".") else EngineBroken)


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("ModuleNotFoundError: No module named 'siconos'", EngineMissing),
        ("ModuleNotFoundError: No module named 'numpy'", EngineMissing),
        ("ImportError: numpy.core.multiarray failed to import", EngineBroken),
    ],
)
def test_a_traceback_is_not_a_reason(line, kind, answered, tmp_path):
    """Without the module it is not installed; one that is there and fails is broken, and its last line says how."""
    trace = tmp_path / "trace.txt"
    trace.write_text(
        "\n".join(
            [
                "Traceback (most recent call last):",
                '  File "solver.py", line 26, in <module>',
                f"    {'import ' * 40}",
                line,
            ]
        )
    )
    said = answered(["/bin/sh", "-c", f"cat {trace} >&2; exit 1"], kind)
    assert "Traceback" not in said and "File" not in said and len(said) <= 2 * LONGEST_REASON
    assert (line.split(":")[0] in said) == (kind is EngineBroken)


@pytest.mark.parametrize("python", [sys.executable, "/python-that-nobody-has"])
def test_the_variable_names_the_python_that_runs_it(python, monkeypatch, in_this_process):
    """The Python of the tests has no Siconos, whatever that of the system has; what is not there has none either."""
    monkeypatch.setenv(adapter.PYTHON_VARIABLE, python)
    with pytest.raises(EngineMissing, match=python) as caught:
        load_engine("siconos")
    assert type(caught.value) is EngineMissing and "Traceback" not in str(caught.value)
    for command in ("engines", "explain slider-bar-case-1"):
        [row] = [
            line
            for line in invoke(command, env={"COLUMNS": "1000"}).output.splitlines()
            if "siconos" in line
        ]
        assert "not installed" in row and "Traceback" not in row
