"""The command line: ``holonom run``, ``check``, ``plot`` and the others.

It is a face of the package and holds nothing that Python cannot do as well.

=============== =================================================================
``commands``    the commands, and the exit status of every error
``flags``       the flags of a run, made of the description in `holonom.options`
``terminal``    what is printed: results for readers, the same as data, errors
``progress``    bars while something takes long
=============== =================================================================

The process around it, its signals and its streams, is ``holonom.__main__``.
"""
