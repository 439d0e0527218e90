"""An examination as a Rerun recording: the evidence runs with their innovations and errors, and the findings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rerun as rr

from trackbench.subjects.doctor.evidence import EvidenceRun
from trackbench.subjects.doctor.examine import Examination
from trackbench.subjects.recording.charts import send_chart
from trackbench.subjects.recording.examination_layout import blueprint, legend
from trackbench.subjects.recording.examination_scene import send_scene, sensors_of
from trackbench.subjects.recording.examination_series import error_charts, innovation_charts
from trackbench.subjects.recording.examination_text import findings
from trackbench.subjects.recording.legend import send_legend
from trackbench.subjects.recording.stream import Stream
from trackbench.subjects.recording.writer import write_recording


def write(examination: Examination, evidence: Sequence[EvidenceRun], path: Path) -> None:
    """Write an examination as a Rerun recording (.rrd) with its layout.

    The timeline is ``sim_time``, the simulated time of each drive in s; positions are in m in the fixed frame. The
    entities of a drive are below its name.

    Raises:
        TrackbenchError: the file cannot be written.
        InputError: the environment switches Rerun off.
    """

    def send(recording: rr.RecordingStream) -> None:
        recording.send_blueprint(blueprint(evidence))
        recording.send_recording_name(examination.tracker)
        stream = Stream(recording)
        stream.markdown("findings", findings(examination))
        send_legend(stream, legend(evidence))
        for run in evidence:
            send_scene(stream, run, sensors_of(evidence))
            for chart in (*error_charts(run), *innovation_charts(run)):
                send_chart(stream, chart)

    write_recording(path, "trackbench doctor", send)
