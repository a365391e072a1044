"""Sphinx, for the site that tools/site/build.py lays together."""

from importlib.metadata import version as version_of

from docutils import nodes
from latex2mathml.converter import convert
from sphinx import addnodes

html_context = {"default_mode": "auto"}
project = "imu-test-stand"
release = version = version_of("imu-test-stand")
copyright = "the authors of imu-test-stand"

extensions = ["myst_nb", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
html_theme = "pydata_sphinx_theme"
html_title = "imu-test-stand"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_logo = "_static/logo.svg"
html_favicon = "_static/logo.svg"
html_show_sourcelink = False
html_copy_source = False
# its summaries are fetched, which no page from a disk may do
html_show_search_summary = False
html_theme_options = {
    "navbar_end": ["theme-switcher"],
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
nb_execution_excludepatterns: list[str] = []
# an output with letters of colour, cut where a stream was cut, is shown as it is
suppress_warnings = ["mystnb.mime_priority", "misc.highlighting_failure"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
templates_path = ["_templates"]
exclude_patterns = ["_static", "_templates"]
html_math_renderer = "mathml"


def _inline(writer, node):
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(writer, node):
    writer.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def _aliases(app, what, name, found, skip, options):
    """Names for types are no members to describe."""
    return True if hasattr(found, "__origin__") else None


def _described_elsewhere(app, doctree):
    """A method's page shows a function that the reference describes: there its source leads."""
    if app.env.docname.startswith("catalogue/"):
        for signature in doctree.findall(addnodes.desc_signature):
            signature["module"] = None


def setup(app):
    """Formulas as MathML, which browsers draw themselves: no script, no network."""
    app.connect("autodoc-skip-member", _aliases)
    app.connect("doctree-read", _described_elsewhere, priority=400)  # before viewcode looks
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
