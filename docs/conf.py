"""Sphinx's settings for the site, which `docs/assemble.py` puts together and `make
site` builds.
"""

import importlib.metadata
import pkgutil
import re
import typing
from dataclasses import is_dataclass

import numpy.typing
import sphinx.pycode.parser
from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.ext.napoleon import NumpyDocstring
from sphinx.util.nodes import make_refnode

import profilecal

project, author = "profilecal", "the profilecal developers"
release = importlib.metadata.version("profilecal")
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
]
exclude_patterns = ["tests", "CITATION.cff", "LICENSE"]

html_theme, html_title = "furo", "profilecal"
html_static_path, html_css_files = ["_static"], ["style.css"]
html_show_copyright, html_copy_source, html_show_sourcelink = False, False, False

# as committed; no scripts from elsewhere
nb_execution_mode, nb_ipywidgets_js = "off", {}
nb_render_markdown_format = "myst"  # outputs have tables and links, too
nb_code_prompt_show = "code"
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_dmath_double_inline, myst_heading_anchors = True, 4
suppress_warnings = ["mystnb.unknown_mime_type", "myst.header"]

mathjax_path = "MathJax/MathJax.js?config=TeX-AMS-MML_HTMLorMML-full"
myst_update_mathjax = False
mathjax2_config = {
    "tex2jax": {
        "inlineMath": [["\\(", "\\)"]],
        "ignoreClass": ".*",
        "processClass": "math|output_area",
    },
    "HTML-CSS": {
        "availableFonts": [],
        "imageFont": None,
        "preferredFont": None,
        "webFont": "STIX-Web",
    },
    "showProcessingMessages": False,
    "messageStyle": "none",
}

# The reference (docs/reference.py): names in `backticks` are links where they exist.
default_role = "py:obj"
autosummary_generate = False
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
maximum_signature_line_length = 100
# a name in signatures, where autodoc would print the union that it stands for
numpy.typing.ArrayLike = typing.NewType("ArrayLike", object)
# comments beside and above the fields of a class say what they are
sphinx.pycode.parser.comment_re = re.compile(r"^\s*#:? ?(.*)\r?\n?$")

ROOMS = {module.name for module in pkgutil.iter_modules(profilecal.__path__)}
LINKED = ("class", "exception", "function", "method", "module")
# examples and `names`; what is between them is prose
CODE = re.compile(r"(^ *>>> .*?(?=^\s*$|\Z)|``.*?``|`[^`]*`)", re.M | re.S)


def as_plain_text(app, what, name, thing, options, lines):
    """Docstrings are plain text: outside code, | and * and a final _ are themselves.
    Those of attributes and properties have no sections such as Parameters.
    """
    parts = CODE.split("\n".join(lines))
    parts[::2] = [re.sub(r"[|*]|(?<=\w)_\b", r"\\\g<0>", part) for part in parts[::2]]
    parts[2::2] = [re.sub(r"\A(?=\w)", r"\\ ", part) for part in parts[2::2]]
    text = "".join(parts).split("\n")
    if what not in ("attribute", "property"):
        text = NumpyDocstring(text, what=what, name=name, obj=thing).lines()
    lines[:] = text


def fields_alone(app, what, name, thing, options, signature, returns):
    """A dataclass has its fields on the lines below; they need not be said twice."""
    return ("", "") if what == "class" and is_dataclass(thing) else None


def as_written(app, doctree):
    """A name is no link to any that only ends like it. Nor, on the pages of public
    names, to a room: parameters have the names of rooms.
    """
    for node in doctree.findall(pending_xref):
        node.attributes.pop("refspecific", None)
        if node.get("reftarget") in ROOMS:
            node["py:module"] = None


def folded(app, doctree):
    """What a page has under its heading Details opens when it is asked to."""
    said = "Checks, other readings, what was tried"
    fold = f"<details class='last'><summary>{said}</summary>"
    for section in doctree.findall(nodes.section):
        if section[0].astext() == "Details":
            section.insert(1, nodes.raw("", fold, format="html"))
            section.append(nodes.raw("", "</details>", format="html"))


def nearest(app, env, node, contnode):
    """A link to the public name, or the only class, function or module, that a name
    can mean.
    """
    target = node.get("reftarget", "")
    if node.get("refdomain") != "py" or not re.search(r"[A-Z._]", target):
        return None
    entries = {
        name: entry
        for name, entry in env.get_domain("py").objects.items()
        if name.endswith(f".{target}") and entry.objtype in LINKED and not entry.aliased
    }
    public = f"profilecal.{target}"
    if len(entries) != 1 and public not in entries:
        return None
    name = public if public in entries else next(iter(entries))
    place = (app.builder, node["refdoc"], entries[name].docname, entries[name].node_id)
    return make_refnode(*place, contnode, name)


def setup(app):
    app.connect("autodoc-process-docstring", as_plain_text)
    app.connect("autodoc-process-signature", fields_alone)
    app.connect("doctree-read", as_written)
    app.connect("doctree-read", folded)
    app.connect("missing-reference", nearest)
