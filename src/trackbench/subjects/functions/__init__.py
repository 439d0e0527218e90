"""Driver assistance functions: their decisions on a tracker's tracks, compared with those on the ground truth.

A scenario's ``functions:`` block comes in; metrics, tables and a section of the report go out. Read ``protocol.py``
first, then ``sums.py``.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    blocks={"functions": f"{__name__}.config:BLOCK"},
    checks={"functions": f"{__name__}.config:function_problems"},
    lists={"functions": Offer(f"{__name__}.config:listed_functions", "")},
    metrics={"functions": f"{__name__}.metrics:function_metrics"},
    examples_of_metrics={"Metrics of a function": f"{__name__}.metrics:published_metrics"},
    records={"functions": f"{__name__}.records:function_records"},
    sections={"functions": f"{__name__}.report:functions_section"},
    tables={"functions": f"{__name__}.report:function_tables"},
    clauses={"functions": f"{__name__}.report:smallest_delays"},
    shown_metrics={"functions": f"{__name__}.report:shown_metrics"},
)
