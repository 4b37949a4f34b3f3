"""Self-contained HTML pages with charts as SVG: no network, light and dark theme.

`parts` makes the page and what stands on it, `charts` the charts. Arguments named `*_html` are
inserted as they are; all other text is escaped here.
"""

__all__: list[str] = []
