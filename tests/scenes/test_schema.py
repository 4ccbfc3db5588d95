"""The schema that editors check scene files by: it knows every key, accepts what `load_scene` accepts, and refuses what is no scene."""

import json
import tomllib

import jsonschema
import pytest
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.scenes import (
    SceneError,
    catalogue,
    load_scene,
    new_scene_text,
    scene_from_dict,
    scene_text,
)
from stiction.scenes.errors import ELEMENTS, LAWS, STABILIZATIONS
from stiction.scenes.model import Scene
from stiction.scenes.schema import SCHEMA_FILE, scene_schema

MODELS = [
    Scene,
    *(model for table in (*ELEMENTS.values(), LAWS, STABILIZATIONS) for model in table.values()),
]


@pytest.fixture(scope="module")
def validator():
    jsonschema.Draft7Validator.check_schema(scene_schema())
    return jsonschema.Draft7Validator(scene_schema())


def changed(change):
    scene = tomllib.loads(scene_text("slider-bar-case-1"))
    change(scene)
    return scene


@pytest.mark.parametrize("name", [*catalogue(), *catalogue("hard")])
def test_every_scene_of_the_catalogue_is_one(name, validator):
    assert not list(validator.iter_errors(tomllib.loads(scene_text(name))))


@pytest.mark.parametrize(
    "change",
    [
        lambda scene: scene.pop("bodies"),
        lambda scene: scene["bodies"].clear(),
        lambda scene: scene.update(gravty=[0, -1]),
        lambda scene: scene["bodies"]["bar"].update(mass=0),
        lambda scene: scene["bodies"]["bar"].update(position=[1]),
        lambda scene: scene["bodies"].update({"two words": scene["bodies"]["bar"]}),
        lambda scene: scene["joints"]["guide"].update(mu=-0.1),
        lambda scene: scene["joints"]["guide"].update(length=0),
        lambda scene: scene["joints"]["guide"].pop("slider"),
        lambda scene: scene["joints"]["guide"].pop("type"),
        lambda scene: scene["joints"]["guide"].update(type="prismatic"),
        lambda scene: scene["drives"]["motor"].update(law=3),
        lambda scene: scene["drives"]["motor"]["law"].update(frequency=1),
        lambda scene: scene["stabilization"].pop("method"),
        lambda scene: scene.update(base="slider-bar-case-1"),
    ],
    ids=range(15),
)
def test_what_it_refuses_is_no_scene(change, validator):
    """Both ways: `load_scene` refuses the same (a missing method included)."""
    scene = changed(change)
    assert list(validator.iter_errors(scene))
    with pytest.raises(SceneError):
        scene_from_dict(scene)


@pytest.mark.parametrize(
    "change",
    [
        lambda scene: scene["joints"]["guide"].update(mu="mu/2", width=0),
        lambda scene: scene["joints"]["guide"].pop("mus"),
        lambda scene: scene.pop("gravity"),
        lambda scene: scene["drives"]["motor"].update(
            law={
                "type": "table",
                "times": [0, 1, 2],
                "values": [0, "pi", 7],
                "interpolation": "cubic",
            }
        ),
    ],
    ids=range(4),
)
def test_what_may_be_left_out_or_written_as_arithmetic(change, validator):
    scene = changed(change)
    assert scene_from_dict(scene) and not list(validator.iter_errors(scene))


def test_every_key_has_its_description():
    """The reference of the format is made from these too."""
    assert [
        f"{model.__name__}.{key}"
        for model in MODELS
        for key, field in model.model_fields.items()
        if not field.description
    ] == []


class TestCommands:
    @pytest.fixture(autouse=True)
    def folder(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        return tmp_path

    @pytest.mark.parametrize("like", [None, "four-bar"])
    def test_new_scene_names_its_schema_and_is_one(self, like, folder, validator):
        ended = CliRunner().invoke(app, ["new", "mine.toml", *(["--like", like] if like else [])])
        assert ended.exit_code == 0, ended.output
        text = (folder / "mine.toml").read_text()
        assert text == f"#:schema {SCHEMA_FILE}\n" + (
            scene_text(like) if like else new_scene_text()
        )
        assert json.loads((folder / SCHEMA_FILE).read_text()) == scene_schema()
        assert not list(validator.iter_errors(tomllib.loads(text)))
        assert (
            load_scene("mine.toml").frictional_guides
            if like is None
            else load_scene("mine.toml") == load_scene(like)
        )

    def test_nothing_is_written_over(self, folder):
        (folder / "mine.toml").write_text("mine")
        ended = CliRunner().invoke(app, ["new", "mine.toml"])
        assert ended.exit_code == 2 and "mine.toml" in ended.output
        assert [path.name for path in folder.iterdir()] == ["mine.toml"] and (
            folder / "mine.toml"
        ).read_text() == "mine"
        (folder / SCHEMA_FILE).write_text("another")
        assert CliRunner().invoke(app, ["new", "other.toml"]).exit_code == 0
        assert (folder / SCHEMA_FILE).read_text() == "another"
