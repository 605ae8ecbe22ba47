"""Every part of ``calibration.json`` takes nothing unknown; no text of it is without a pattern, in a field or a key."""

import json
import typing
from typing import Annotated

import pytest
from pydantic import AfterValidator, BaseModel, StringConstraints, TypeAdapter, ValidationError

import irbcal
from irbcal.errors import CalibrationError
from irbcal.files import seal
from irbcal.files.schema import Record
from irbcal.files.section import Date, Fingerprint, Name, Names, Section, Sentence, Sha256, Version, Word
from irbcal.files.signature import Signature


class Number(Section):
    value: float


def test_unknown_keys_and_numbers_that_are_none_are_refused():
    assert Number(value=1.0).value == 1.0
    with pytest.raises(ValidationError, match="extra"):
        Number(value=1.0, other=2.0)
    with pytest.raises(ValidationError, match="finite"):
        Number(value=float("nan"))


def free(kind, place, checked=False):
    """Places of texts without a pattern in a type."""
    if kind is str or kind is typing.Any:
        return [] if checked else [place]
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin is Annotated:
        rules = any(isinstance(rule, (StringConstraints, AfterValidator)) for rule in inside[1:])
        return free(inside[0], place, checked or rules)
    if origin is typing.Literal:
        return []
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return fields(kind, place)
    return [found for k, part in enumerate(inside) for found in free(part, f"{place}[{k}]", checked)]


def fields(model, place=""):
    hints = typing.get_type_hints(model, include_extras=True)
    return [found for name in model.model_fields for found in free(hints[name], f"{place}.{name}")]


def test_every_text_has_a_pattern():
    assert fields(Record) == []
    assert fields(Signature) == []

    class Bad(BaseModel):
        a: list[str]
        b: dict[str, Name]
        c: str | None
        d: typing.Any
        e: dict[Name, Word | float]

    assert fields(Bad) == [".a[0]", ".b[0]", ".c[0]", ".d"]


@pytest.mark.parametrize("kind", [Date, Fingerprint, Name, Sentence, Sha256, Version, Word])
@pytest.mark.parametrize("text", ["\x1b[31m", "a\nb", "a\u2028b", "\u202ea", "a\x9b", "a" * 20_001])
def test_texts_that_could_act_are_refused(kind, text):
    with pytest.raises(ValidationError):
        TypeAdapter(kind).validate_python(text)
    with pytest.raises(ValidationError):
        TypeAdapter(Names).validate_python(["a", text])


def test_a_foreign_fingerprint_is_refused_with_its_place(folder, tmp_path):
    content = json.loads((folder / "calibration.json").read_text())
    content["fingerprint"] = 'x"""\nimport os; os.system("touch canary")\n"""'
    (tmp_path / "calibration.json").write_text(json.dumps(seal.sealed(content)))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    with pytest.raises(CalibrationError, match="fingerprint: String should match pattern"):
        irbcal.load(tmp_path)
