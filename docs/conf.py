"""Settings of Sphinx for the site; `docs/build_site.py` writes its sources and builds it."""

from campaign.row_build import clearcap_version

project = "clearcap"
author = "clearcap"
version = release = clearcap_version()
root_doc = "index"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 6
suppress_warnings = ["myst.header", "misc.highlighting_failure"]  # a page may begin with a picture; sessions have "..."
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True  # or an attribute that is documented twice is a warning
default_role = "literal"
html_theme = "furo"
html_title = f"clearcap {release}"
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
templates_path: list[str] = []
