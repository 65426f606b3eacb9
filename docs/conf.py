"""Sphinx's settings for the site, which `docs/assemble.py` puts together and `make
site` builds.
"""

import importlib.metadata

project, author, release = (
    "profilecal",
    "the profilecal developers",
    importlib.metadata.version("profilecal"),
)
extensions = ["myst_nb", "sphinx.ext.mathjax"]
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
