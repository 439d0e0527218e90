"""Engines that compute the equations of filters, models and scores: NumPy, or machine code traced from the same.

Equations (functions written with NumPy) and arrays over a batch come in; arrays go out, by either engine alike. A
kernel is the machine code of equations; a guard is the run-time check that its trace holds for a member of the batch.
Read ``equations.py`` first, then ``kernels.py``.
"""
