"""Results: the file that a run is written to, and the same in memory.

What a user has in a file is never lost, and what is damaged is never believed.

================ ================================================================
``layout``       what stands where in the file, which is one of SQLite, with checksums
``writer``       writes it while the run goes on, so that a kill loses nothing
``contents``     what a file says that it holds, verified when it is opened
``reader``       arrays from it
``attempts``     the log of attempted steps, summed by outcome
``integrity``    what must hold before any part of it is believed
``facts``        what a result says about its run, checked before it is relied on
``legacy``       results of older formats, read as the present one
``locks``        who writes a file; ends with the process
``continuation`` runs that go on from a result, appended to it
``memory``       a result that has no file: the arrays of the core
================ ================================================================

The rooms above it, `holonom.result` and `holonom.simulation`, use ``Reader``, ``Writer`` and
``Memory``; it knows no model and no equations.
"""
