"""Studies: methods and tolerances of one model against a reference.

`holonom.compare` starts one. ``accuracy`` says how far a run is from a reference, ``runs`` makes
many runs in one process or in several, ``compare`` puts both together, ``comparison`` is what
comes of it.
"""
