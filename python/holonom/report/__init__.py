"""One page about a run: a single HTML file with its pictures inside.

=============== =================================================================
``page``        the page: what stands in it, in the order in which it is read
``tables``      extrema, parameters, errors and facts as tables
``extrema``     the smallest and largest values of channels, between rows, too
``figures``     pictures, and the numbers behind them for cursor and zoom
``graph``       how bodies hang on each other, as a picture
``page.css``    how it looks on a screen, a telephone and paper
``page.js``     cursor, zoom and the 3-D view; without it the page is complete
=============== =================================================================
"""

from holonom.report.page import render, write

__all__ = ["render", "write"]
