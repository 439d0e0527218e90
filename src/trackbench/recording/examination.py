"""An examination as a Rerun recording: each drive that shows a finding, its innovations and errors, the findings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rerun as rr

from trackbench.doctor.examine import Examination
from trackbench.doctor.exhibits import Exhibit
from trackbench.recording.examination_layout import blueprint
from trackbench.recording.examination_scene import send_scene
from trackbench.recording.examination_series import send_series
from trackbench.recording.examination_text import findings
from trackbench.recording.stream import Stream
from trackbench.recording.writer import write_recording


def write(examination: Examination, exhibits: Sequence[Exhibit], path: Path) -> None:
    """Write an examination as a Rerun recording (.rrd) with its layout.

    The timeline is ``sim_time``, in seconds of simulated time of each drive; positions are in metres of the fixed
    frame. Everything of a drive lies below its name.

    Raises:
        TrackbenchError: the file cannot be written.
        InputError: the environment switches Rerun off.
    """

    def send(recording: rr.RecordingStream) -> None:
        recording.send_blueprint(blueprint(exhibits))
        recording.send_recording_name(examination.tracker)
        stream = Stream(recording)
        stream.markdown("findings", findings(examination))
        for exhibit in exhibits:
            send_scene(stream, exhibit)
            send_series(stream, exhibit)

    write_recording(path, "trackbench doctor", send)
