"""Templates: what is put into them is a literal, nothing may be missing, and compiling is done once."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from importlib.util import cache_from_source
from typing import Any

import jinja2
from jinja2.bccache import Bucket, BytecodeCache
from markupsafe import Markup

from irbcal import page_style


class Compiled(BytecodeCache):
    """Compiled templates beside the compiled modules of their folder, as Python keeps those, and where it may.

    A file that is missing, damaged, or of another template or version counts as none.
    """

    def get_bucket(
        self, environment: jinja2.Environment, name: str, filename: str | None, source: str
    ) -> Bucket:  # the name of the file is where it is kept
        """The compiled template of a source, empty where none is kept."""
        bucket = Bucket(environment, filename or "", self.get_source_checksum(source))
        self.load_bytecode(bucket)
        return bucket

    def get_source_checksum(self, source: str) -> str:
        """What the compiled template depends on; all environments are those of `environment`."""
        return hashlib.sha256(f"{jinja2.__version__}\n{source}".encode()).hexdigest()

    def load_bytecode(self, bucket: Bucket) -> None:
        """Read what is kept."""
        with suppress(OSError, EOFError, ValueError, TypeError), open(cache_from_source(bucket.key), "rb") as file:
            bucket.load_bytecode(file)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep it, whole or not at all."""
        if sys.dont_write_bytecode or not bucket.key:
            return
        path = cache_from_source(bucket.key)
        with suppress(OSError):
            os.makedirs(os.path.dirname(path), exist_ok=True)
            handle, name = tempfile.mkstemp(dir=os.path.dirname(path))
            try:
                with open(handle, "wb") as file:
                    bucket.write_bytecode(file)
                os.replace(name, path)
            except OSError:
                os.unlink(name)


@cache
def environment(
    package: str, folder: str = "templates", trim: bool = True, literal: Callable[[Any], str] | None = None
) -> jinja2.Environment:
    """Templates of a package, and the frame of all pages; each is compiled once a process.

    Parameters
    ----------
    package : str
        Such as ``irbcal.reports``.
    folder : str
        Of the templates in it.
    trim : bool
        Lines that hold nothing but a statement leave nothing.
    literal : callable, optional
        What every value becomes but `markupsafe.Markup`, see `irbcal.literals`; escaped text of HTML unless given.
    """
    options: dict[str, Any] = {"trim_blocks": trim, "lstrip_blocks": trim}
    templates = jinja2.Environment(
        loader=jinja2.ChoiceLoader(
            [jinja2.PackageLoader(package, folder), jinja2.PackageLoader("irbcal.page_style", "")]
        ),
        autoescape=literal is None,
        finalize=None if literal is None else partial(_literal, literal),
        keep_trailing_newline=literal is not None,
        undefined=jinja2.StrictUndefined,
        bytecode_cache=Compiled(),
        **options,
    )
    templates.globals["page_style"] = page_style.style
    return templates


def _literal(literal: Callable[[Any], str], value: Any) -> str:
    return str(value) if isinstance(value, (Markup, jinja2.Undefined)) else literal(value)
