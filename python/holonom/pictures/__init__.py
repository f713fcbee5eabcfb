"""Pictures: what they show, round numbers along their axes, how they are drawn.

=============== =================================================================
``picture``     panels of lines as data; `Picture.save` is the door to the rest
``runs``        the pictures of channels, steps, residuals, energy and comparisons
``curves``      channels of a run, or a part of it: filtered, differentiated, named
``traces``      signals as lines of so many points as are seen, and as ranges
``ticks``       round numbers along an axis
``svg``         pictures as SVG, by parts of our own: a plain install draws them
``plotting``    other formats, and axes of one's own, by matplotlib
=============== =================================================================
"""
