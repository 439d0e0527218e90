"""Rerun recordings of runs: the scene of one Monte-Carlo run, and the scores over all runs.

A ``Result`` comes in; ``recording.rrd``, pictures and printed moments go out. Read ``writer.py`` first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={
        "inspect": Offer(f"{__name__}.commands:inspect_command", "Read a recording without a viewer."),
        "snapshot": Offer(
            f"{__name__}.commands:snapshot_command", "Save a picture of a run, at a time or at its worst moment."
        ),
        "view": Offer(f"{__name__}.commands:view_command", "Open runs in the Rerun viewer."),
    },
    artifacts={"recording.rrd": Offer(f"{__name__}.writer:write", "the Rerun recording")},
    replays={"recording.rrd": f"{__name__}.writer:write_replay"},
    run_options={"live": f"{__name__}.commands:RUN_OPTIONS"},
)
