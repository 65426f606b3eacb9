"""The map of the papers' contents."""

import pandas as pd
import pytest

from profilecal.papers import contents, scorecard
from profilecal.running import notebooks


def test_references_are_read_as_people_write_them():
    assert contents.references("Table I, Eqs 1-3") == {("Table", "I"), ("Eq", "1"), ("Eq", "2"), ("Eq", "3")}
    assert contents.references("Tables III and IV, Fig. 8") == {("Table", "III"), ("Table", "IV"), ("Fig", "8")}
    assert contents.references("Sections 2.1 and V-D3") == {("Section", "2.1"), ("Section", "V-D3")}


@pytest.mark.parametrize(
    ("paper", "item", "part"),
    [
        ("Xu 2021", "after Eq. 26", "Sections 2, 2.1 and 2.2, Eqs 1-35"),
        ("Xu 2021", "Figs 6-7", "Table 1, Fig. 6"),
        ("Xu 2021", "Section 4.2", "Section 4.2, Table 3, Fig. 8"),
        ("Chen 2018", "Table I, Eq. 49", "Section V-A, Fig. 14, Table I, Eqs 48-51"),
        ("Chen 2018", "Table IV", "Section V-D2, Tables III and IV, Eqs 53-56"),
        ("Chen 2018", "Section IV-D", "Section IV, Eqs 21-47, Figs 6-13"),
    ],
)
def test_a_scorecard_item_finds_its_part(paper, item, part):
    assert contents.CONTENTS[contents.place(paper, item)][1] == part


def test_every_equation_figure_and_table_of_the_papers_has_a_place_and_one_only():
    every = {
        "edge": {"Eq": range(1, 36), "Fig": range(1, 9), "Table": (1, 2, 3)},
        "disk": {"Eq": range(1, 57), "Fig": range(1, 18), "Table": ("I", "II", "III", "IV")},
    }
    for paper, kinds in every.items():
        named = [name for short, part, *_ in contents.CONTENTS if short == paper for name in contents.references(part)]
        expected = {(kind, str(number)) for kind, numbers in kinds.items() for number in numbers}
        assert {name for name in named if name[0] != "Section"} == expected
        assert len(named) == len(set(named))


def test_the_map_keeps_every_row_and_links_what_is_there(tmp_path):
    (tmp_path / "10_edge.ipynb").touch()
    rows = [
        scorecard.row("edge", "Eq. 5", "a", 1.0, 1.0, "1", 0.1),
        scorecard.row("edge", "Appendix", "b", None, 2.0, "1"),
    ]
    card = scorecard.to_frame(rows).assign(notebook="10_edge")
    lines = contents.contents_map(card, tmp_path).splitlines()
    (eqs,) = [line for line in lines if "Eqs 1-35" in line]
    assert "| [10](10_edge.ipynb) 12 | 1 reproduced |" in eqs
    assert lines[-1] == "| Xu 2021 | Appendix |  | [10](10_edge.ipynb) | 1 unpublished |"
    assert len(lines) == 2 + len(contents.CONTENTS) + 1


def test_a_map_without_any_results_still_shows_where_to_look(tmp_path):
    card = pd.DataFrame([], columns=scorecard.COLUMNS)
    assert len(contents.contents_map(card, tmp_path).splitlines()) == 2 + len(contents.CONTENTS)


def test_the_notebooks_that_the_map_names_are_there():
    there = {path.stem[:2] for path in notebooks.find([])}
    named = {number for *_, numbers in contents.CONTENTS for number in numbers.split()}
    assert named <= there
