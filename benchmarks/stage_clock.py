"""One command of trackbench, with the time of each stage written to a file as JSON.

Run as ``python benchmarks/stage_clock.py FILE COMMAND...``, because only a process of its own imports everything. A
stage's time is its own: what is spent in another stage that it calls, or in an import, counts there.
"""

from __future__ import annotations

import functools
import json
import os
import sys
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

#: By stage, what it consists of: a function, or a method, of a module.
STAGES = {
    "scenario": ["trackbench.scenario.load:load_scenario", "trackbench.scenario.check:check_plugins"],
    "truth": ["trackbench.scenario.truth:PendingTruths.__init__", "trackbench.scenario.truth:PendingTruths.collect"],
    "sensing": ["trackbench.sensing.scans:sense_known", "trackbench.sensing.scans:ideal_sensors"],
    "tracking": ["trackbench.runner.labelled_run:LabelledRun.advance"],
    "scoring": [
        "trackbench.metrics.conditions:condition_classes",
        "trackbench.metrics.scorer:Scorer.scan",
        "trackbench.metrics.scorer:Scorer.estimate",
        "trackbench.metrics.scorer:Scorer.close",
        "trackbench.metrics.scorer:score_waiting",
        "trackbench.runner.targets:Targets.__init__",
        "trackbench.runner.targets:Targets.of",
    ],
    "assembling": ["trackbench.runner.assemble:assemble"],
    "tables and JSON": ["trackbench.results.result:Result.save", "trackbench.results.result:Result.json"],
    "report": [
        "trackbench.report.result:result_document",
        "trackbench.document.html:to_html",
        "trackbench.document.markdown:to_markdown",
    ],
    "figures": ["trackbench.document.drawing:svg_in_page", "trackbench.document.drawing:svg_file"],
    "recording": ["trackbench.subjects.recording.writer:write"],
    "tracing": ["trackbench.engine.trace:trace"],
    "emitting": ["trackbench.engine.vector_code:kernel_text"],
    "compiling": ["trackbench.engine.machine:Processor.object_code"],
    "loading kernels": ["trackbench.engine.machine:Processor.function"],
    "comparison": ["trackbench.compare.assembly:compare_results", "trackbench.report.comparison.document:batch_files"],
}
IMPORTS, REST = "imports", "the rest"


class StageClock:
    """Processor time and elapsed time by stage; only the innermost stage's clock runs."""

    def __init__(self) -> None:
        self.spent: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
        self._running = [REST]
        self._since = (time.process_time(), time.perf_counter())

    def go_on_in_child(self) -> None:
        """In a process that is forked, whose processor time begins at zero."""
        self._since = (time.process_time(), time.perf_counter())

    def _switch(self) -> None:
        now = (time.process_time(), time.perf_counter())
        spent = self.spent[self._running[-1]]
        for kind, (end, begin) in enumerate(zip(now, self._since, strict=True)):
            spent[kind] += end - begin
        self._since = now

    def timed(self, stage: str, call: Any) -> Any:
        """The same function, whose time counts for a stage."""

        @functools.wraps(call)
        def timed(*arguments: Any, **options: Any) -> Any:
            self._switch()
            self._running.append(stage)
            try:
                return call(*arguments, **options)
            finally:
                self._switch()
                self._running.pop()

        return timed

    def stop(self) -> dict[str, list[float]]:
        """By stage, seconds of the processor and elapsed."""
        self._switch()
        return dict(self.spent)

    def watch(self) -> None:
        """Time every import from now on, and each stage's functions as soon as their module is there."""
        by_module: dict[str, list[tuple[str, str]]] = defaultdict(list)
        for stage, places in STAGES.items():
            for module, _, path in (place.partition(":") for place in places):
                by_module[module].append((stage, path))
        # What ``import`` itself calls where a module is not there yet.
        bootstrap: Any = sys.modules["_frozen_importlib"]
        find_and_load = self.timed(IMPORTS, bootstrap._find_and_load)

        def load(name: str, import_: Any) -> Any:
            module = find_and_load(name, import_)
            for stage, path in by_module.pop(name, []):
                owner, attribute = owner_of(module, path)
                setattr(owner, attribute, self.timed(stage, getattr(owner, attribute)))
            return module

        bootstrap._find_and_load = load


def owner_of(module: Any, path: str) -> tuple[Any, str]:
    """Where the function or method is an attribute, and its name."""
    *outer, attribute = path.split(".")
    return functools.reduce(getattr, outer, module), attribute


def main(file: str, command: list[str]) -> None:
    clock = StageClock()
    clock.watch()
    os.register_at_fork(before=clock.stop, after_in_child=clock.go_on_in_child)
    from trackbench.cli import main as trackbench

    sys.argv = ["trackbench", *command]
    try:
        status = trackbench()
    except SystemExit as error:
        status = error.code
    if status not in (None, 0, 1):
        sys.exit(status)
    Path(file).write_text(json.dumps(clock.stop()), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
