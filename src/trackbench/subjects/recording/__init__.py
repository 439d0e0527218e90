"""A run as a Rerun recording: the scene of one Monte-Carlo run, and the scores over all of them."""

from trackbench.base.subjects import Command, Subject

SUBJECT = Subject(
    commands={
        "inspect": Command(f"{__name__}.commands:inspect_command", "Read a recording without a viewer."),
        "snapshot": Command(
            f"{__name__}.commands:snapshot_command",
            "Save a picture of a run, at a time or at its worst moment.",
        ),
        "view": Command(f"{__name__}.commands:view_command", "Open runs in the Rerun viewer."),
    },
    artifacts={"recording.rrd": f"{__name__}.writer:write"},
    replays={"recording.rrd": f"{__name__}.writer:write_replay"},
    run_options={"live": f"{__name__}.commands:RUN_OPTIONS"},
)
