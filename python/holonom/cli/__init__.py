"""The command line: ``holonom run``, ``check``, ``plot`` and the others.

It is a face of the package and holds nothing that Python cannot do as well.

============== ==================================================================
``commands``   which commands there are, and the exit status of every error
``running``    ``run``
``comparing``  ``compare``, ``diff``
``describing`` ``check``, ``info``, ``models``, ``schema``
``drawing``    ``plot``, ``report``, ``view``, ``render``
``exporting``  ``export``
``arguments``  what several commands take: models, results, flags
``flags``      the flags of a run, made of the description in `holonom.options`
``words``      what users write there, as numbers, paths, tolerances and values
``terminal``   what is printed: results for readers, the same as data, errors
``progress``   bars while something takes long
============== ==================================================================

The process around it, its signals and its streams, is ``holonom.__main__``.
"""
