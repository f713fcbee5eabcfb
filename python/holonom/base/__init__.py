"""What every room may use, and what knows no mechanism.

=========== =====================================================================
``errors``  what can go wrong, with stable codes
``files``   the one writer of files: what may be replaced, beside and renamed
``text``    text that is safe to show
``names``   the name that was meant
``plain``   what users pass, as plain data
``record``  plain data with attributes
``toml``    plain data as TOML
=========== =====================================================================
"""
