"""Sphinx configuration: everything about the API comes from the docstrings."""

project = "Sonospline"
author = "The Sonospline developers"
copyright = "2026, the Sonospline developers"
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "Sonospline"
nitpicky = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
myst_enable_extensions = ["dollarmath"]
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
