"""Compiled templates are kept, and a page is the same with and without them."""

import sys

import jinja2
import pytest

from irbcal import templates


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "own_pages" / "templates").mkdir(parents=True)
    (tmp_path / "own_pages" / "__init__.py").touch()
    (tmp_path / "own_pages" / "templates" / "page.j2").write_text("{% if a %}\n<{{ a }}>\n{% endif %}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own_pages", raising=False)
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    monkeypatch.setattr("sys.pycache_prefix", None)
    return tmp_path / "own_pages" / "templates"


def page():
    """As another process makes it: within one, an environment keeps its templates."""
    return templates.environment.__wrapped__("own_pages").get_template("page.j2").render(a="&")


def test_a_compiled_template_is_kept_and_follows_its_source(folder, monkeypatch):
    assert page() == "<&amp;>\n"
    (kept,) = (folder / "__pycache__").iterdir()
    monkeypatch.setattr(jinja2.Environment, "_parse", lambda *_: pytest.fail("compiled again"))
    assert page() == "<&amp;>\n"
    monkeypatch.undo()
    monkeypatch.syspath_prepend(folder.parents[1])
    (folder / "page.j2").write_text("{{ a }}.")
    assert page() == "&amp;."
    kept.write_bytes(kept.read_bytes()[:-20])
    assert page() == "&amp;."


def test_where_nothing_can_be_kept_pages_are_the_same(folder):
    (folder / "__pycache__").write_text("a file where the folder should be")
    assert page() == "<&amp;>\n"


def test_a_process_compiles_a_template_once(folder, monkeypatch):
    def made():
        return templates.environment("own_pages").get_template("page.j2")

    monkeypatch.setattr("sys.dont_write_bytecode", True)
    templates.environment.cache_clear()
    first = made()
    monkeypatch.setattr(jinja2.Environment, "_parse", lambda *_: pytest.fail("compiled again"))
    assert made() is first
    templates.environment.cache_clear()
