"""Every mutation of the list can be made, stands in the documentation, and is found."""

import pytest
from mutations import (
    PAGE,
    PARTS,
    RESULTS,
    ROOT,
    UNSEEN,
    Answer,
    Mutation,
    mutations,
    page,
    read_results,
    tried,
)

from stiction.engines.registry import ENGINES

MUTATIONS = mutations()
pytestmark = pytest.mark.skipif(not (ROOT / "mkdocs.yml").exists(), reason="needs the checkout")


def test_the_list_covers_all_parts_and_all_engines():
    assert len(MUTATIONS) >= 40 and {mutation.part for mutation in MUTATIONS} == set(PARTS)
    engines = {engine for mutation in MUTATIONS for engine in mutation.engines}
    assert engines >= {entry.name for entry in ENGINES if not entry.run_by_system}
    assert engines <= {entry.name for entry in ENGINES}
    assert len({mutation.name for mutation in MUTATIONS}) == len(MUTATIONS)


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.name)
def test_it_can_be_made(mutation, tmp_path):
    """Once, where it says, in code that still is code."""
    (path := tmp_path / mutation.file).parent.mkdir(parents=True)
    path.write_text((ROOT / mutation.file).read_text())
    mutation.apply(tmp_path)
    compile(path.read_text(), path, "exec")
    assert all(
        (ROOT / test.partition("::")[0]).exists()
        for test in mutation.tests
        if test.startswith("tests/")
    )
    with pytest.raises(ValueError, match="0 times; expected once"):
        mutation.apply(tmp_path)


def test_the_page_has_the_list():
    written = PAGE.read_text().splitlines()
    assert [line.partition("`")[0] for line in written] == [
        line.partition("`")[0] for line in page({}).splitlines()
    ]
    assert not [line for line in written if line.endswith(f"| {UNSEEN} | {UNSEEN} | {UNSEEN} |")]


def test_an_answer_is_kept_until_the_mutation_is_another(tmp_path):
    mutation = MUTATIONS[0]
    answer = Answer(mutation.digest, UNSEEN, "rhs, slider-bar-case-1/reference/rtol=1e-09")
    assert answer.is_found and not Answer(mutation.digest, UNSEEN, UNSEEN, UNSEEN).is_found
    row = next(
        line
        for line in page({mutation.name: answer}).splitlines()
        if line.startswith(f"| {mutation.name} |")
    )
    assert row.endswith("| not found | rhs, slider-bar-case-1/reference/rtol=1e-09 | not asked |")
    old = Answer("of another text", UNSEEN, "rhs")
    assert "not tried | not tried" in next(
        line
        for line in page({mutation.name: old}).splitlines()
        if line.startswith(f"| {mutation.name} |")
    )


@pytest.mark.long
def test_a_comment_is_not_found():
    """Nothing but the text of a file is other: tests, check and night that find it would find anything."""
    harmless = Mutation(
        "a comment",
        "equations",
        "truths/closed_form/pendulum.py",
        "from __future__",
        "# nothing\nfrom __future__",
        ("tests/truths/test_closed_form.py",),
        night=("pendulum",),
    )
    assert not tried(harmless).is_found


@pytest.mark.long
@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.name)
def test_it_is_found(mutation):
    answer = read_results(RESULTS).get(mutation.name)
    assert (answer if answer and answer.digest == mutation.digest else tried(mutation)).is_found
