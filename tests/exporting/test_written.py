"""What templates of exports are given becomes a literal without being asked for."""

import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

from irbcal.exporting.parts import LANGUAGES
from irbcal.templates import environment


@pytest.mark.parametrize("language", LANGUAGES)
def test_values_are_literals_unless_they_are_code(language):
    made = environment("irbcal.exporting", literal=LANGUAGES[language])
    shown = made.from_string("{{ text }} {{ number }} {{ code }}").render(text='x"\n', number=1.5, code=Markup("a = 1"))
    assert shown.splitlines() == [shown]
    assert shown in ("'x\"\\n' 1.5 a = 1", '"x\\042\\012" 1.5 a = 1')
    with pytest.raises(UndefinedError):
        made.from_string("{{ missing }}").render()
