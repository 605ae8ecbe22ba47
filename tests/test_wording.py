"""Parts of sentences."""

from irbcal.wording import and_more, counted, first_of, joined


def test_numbers_have_the_form_of_their_nouns():
    assert [counted(n, "pose") for n in (0, 1, 2)] == ["0 poses", "1 pose", "2 poses"]
    assert [counted(n, "mesh is", "meshes are") for n in (1, 2)] == ["1 mesh is", "2 meshes are"]


def test_lists_are_cut_short_and_joined():
    names = ["a", "b", "c"]
    assert [first_of(names, most) for most in (2, 3, None)] == ["a, b … and 1 more", "a, b, c", "a, b, c"]
    assert [joined(names[:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]
    assert [and_more(n) for n in (0, 4)] == ["", " and 4 more"]
