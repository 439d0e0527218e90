"""The benchmark's tables of where the time of a command goes."""

from __future__ import annotations

from typing import Any

from benchmarks.table_cells import digits, goals

#: What kernels cost, by stage.
KERNELS = ("tracing", "emitting", "compiling", "loading kernels")


def compiling(found: dict[str, Any]) -> str:
    """What the kernels of a run cost the first time and later, as a section."""
    first, again = [item for item in found["commands"] if item["engine"] == "fused"][:2]

    def cells(item: dict[str, Any]) -> str:
        spent = {stage: cpu for stage, (cpu, _) in item["stages"].items()}
        costs = [spent.get(stage, 0.0) for stage in KERNELS]
        return " | ".join(map(digits, (*costs, sum(costs), sum(spent.values()))))

    return "\n".join(
        [
            "## Compiling",
            "",
            f"`{again['command']}` by the fused engine takes {found['kernels']} kernels. Processor seconds to trace "
            "the equations, to emit them as LLVM's language, to compile and to load them, with nothing cached and with "
            "all: what is compiled is kept on disk.",
            "",
            f"| | {' | '.join(KERNELS)} | all of these | the command |",
            f"|---|{'---:|' * len(KERNELS)}---:|---:|",
            f"| the first time | {cells(first)} |",
            f"| again | {cells(again)} |",
            "",
        ]
    )


def stages(before: dict[str, Any], found: dict[str, Any]) -> str:
    """Seconds of each stage of each command, before and by each engine, as a section."""
    after = {(item["command"], item["engine"]): item for item in found["commands"]}
    old = {item["command"]: item for item in before["commands"]}
    commands = list(dict.fromkeys(command for command, _ in after))
    names = list(dict.fromkeys(stage for item in (*old.values(), *after.values()) for stage in item["stages"]))

    def row(name: str, *cells: str) -> str:
        return f"| {name} | {' | '.join(cells)} |"

    def cell(command: str, kind: int, chosen: list[str]) -> str:
        def seconds(item: dict[str, Any]) -> float:
            return sum(item["stages"].get(stage, (0.0, 0.0))[kind] for stage in chosen)

        numpy, fused = after[command, "numpy"], after[command, "fused"]
        then = old.get(command)
        # What a second of then is worth now.
        scaled = f"{seconds(then) * numpy['fixed_work'] / then['fixed_work']:.2f}" if then else ""
        return " → ".join(filter(None, (scaled, f"{seconds(numpy):.2f}", f"{seconds(fused):.2f}")))

    return "\n".join(
        [
            "## Where the time goes",
            "",
            f"Processor seconds of each stage at commit {before['commit']} → now by NumPy → now by the fused engine, "
            "in one process and one thread; of a command that was not measured then, the latter two. A fixed piece of "
            "work, timed beside each command then and now, turns the seconds of then into those of now. Truth and "
            "kernels are cached, but for the first command. A sweep has one vehicle, 200 measurements and 20 runs.",
            "",
            row("stage", *(f"`{command}`" if "run" in command else command for command in commands)),
            row("---", *("---:" for _ in commands)),
            *(row(name, *(cell(command, 0, [name]) for command in commands)) for name in names),
            row("all", *(cell(command, 0, names) for command in commands)),
            row("elapsed", *(cell(command, 1, names) for command in commands)),
            "",
            *goals(found["goals"]),
            "",
        ]
    )
