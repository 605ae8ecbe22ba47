"""Settings of the documentation: ``scripts/docs`` builds it, without network."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

import irbcal  # noqa: E402

project = "irbcal"
author = "The irbcal authors"
copyright = "The irbcal authors"
release = version = irbcal.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton", "reference", "formulas"]
html_math_renderer = "mathml"
exclude_patterns = ["_build", "_extensions", "jupyter_execute", ".jupyter_cache"]
html_theme = "furo"
html_title = f"irbcal {release}"
html_copy_source = False
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["wide.css"]

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / "notebooks")
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

napoleon_numpy_docstring = True
napoleon_use_rtype = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
default_role = "code"
highlight_language = "bash"
smartquotes = False
copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True
