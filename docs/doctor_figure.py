"""Draws the figure of docs/doctor.md: the radar's innovations where the student's tracker loses its target."""

import sys
from dataclasses import replace
from pathlib import Path

from trackbench.document.drawing import svg_file
from trackbench.subjects.doctor.drive_figures import innovation_figure
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.subject import find_tracker

DOCS = Path(__file__).parent
ALTERNATIVE = "Azimuth innovation of the radar over time, applied by the tracker and expected"


def main() -> None:
    sys.path.insert(0, str(DOCS / "examples"))
    examined = find_tracker("sensor_fusion_student:Tracker", {})
    doctor = Doctor(examined.sensors)
    run = doctor.evidence(doctor.examine(examined.name, examined.make), examined.make)[0]
    radar = next(one for one in run.innovations if one.sensor == "radar")
    drawn = replace(innovation_figure(run, radar), alternative=ALTERNATIVE)
    (DOCS / "images" / "doctor-innovation.svg").write_text(svg_file(drawn), encoding="utf-8")


if __name__ == "__main__":
    main()
