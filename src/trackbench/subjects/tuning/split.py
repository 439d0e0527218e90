"""On which scenes and noise a tracker is tuned, and on which others it is then tried."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

from trackbench.base.errors import InputError
from trackbench.scenario import Scenario
from trackbench.scenario.recorded_checks import same_every_run

#: Scenes of each scenario that are tuned on, and those that are tried on, unless it is said.
TRAIN_SCENES, TEST_SCENES = 4, 8
#: Most runs of each scene that is tuned on, where there are several: other traffic tells more than other noise.
TRAIN_RUNS = 25
#: The seeds of traffic for tuning begin here: above those that scenarios use.
FIRST_SEED = 1001

#: What tells noise tried on from noise tuned on where every run has the same truth.
SAME_MOTION = "other noise of the same motion"


@dataclass(frozen=True)
class Split:
    """What is tuned on and what is tried on; None: as usual."""

    train_scenes: int | None = None
    test_scenes: int | None = None
    train_runs: int | None = None
    test_runs: int | None = None
    train_seed: int | None = None
    test_seed: int | None = None


@dataclass(frozen=True)
class Halves:
    """A scenario for tuning and one for trying."""

    train: Scenario
    test: Scenario
    apart: str
    """What tells them apart, in words; empty where nothing does."""


def halved(loaded: Scenario, split: Split) -> Halves:
    """The scenario with some scenes and noise, and with others.

    The scenes tried on are the scenario's own, and those after them; the noise of both is drawn by different seeds.

    Raises:
        InputError: scenes are asked for of a source that has no others.
    """
    config = loaded.config
    several = "seeds" in type(config.truth).model_fields
    if not several and (split.train_scenes is not None or split.test_scenes is not None):
        problem = f"{config.name} has one scene; tuning on others is for truths with seeds"
        raise InputError(problem, key="--train-scenes" if split.train_scenes is not None else "--test-scenes")
    train_seed = config.monte_carlo.seed + 1 if split.train_seed is None else split.train_seed
    test_seed = config.monte_carlo.seed if split.test_seed is None else split.test_seed
    if train_seed == test_seed:
        raise InputError("is that of the noise that the values are tried on; give another", key="--train-seed")
    if same_every_run(config):
        return Halves(loaded, loaded, "")
    runs = config.monte_carlo.runs
    train_runs, test_runs = split.train_runs or (min(runs, TRAIN_RUNS) if several else runs), split.test_runs or runs
    if not several:
        apart = "other noise and other random motion" if config.truth.random else SAME_MOTION
        return Halves(_drawn(loaded, train_runs, train_seed), _drawn(loaded, test_runs, test_seed), apart)
    own = [scene.seed for scene in config.truth.scenes()]  # type: ignore[attr-defined]
    wanted = split.test_scenes or (len(own) if len(own) > 1 else TEST_SCENES)
    own = own[:wanted] if wanted <= len(own) else [own[0] + number for number in range(wanted)]
    free = (seed for seed in itertools.count(FIRST_SEED) if seed not in own)
    others = list(itertools.islice(free, split.train_scenes or TRAIN_SCENES))
    return Halves(
        _drawn(loaded, train_runs, train_seed, others),
        _drawn(loaded, test_runs, test_seed, own),
        "other scenes and other noise",
    )


def _drawn(loaded: Scenario, runs: int, seed: int, scenes: list[int] | None = None) -> Scenario:
    """The scenario with other runs, noise and scenes."""
    config = loaded.config
    truth = config.truth if scenes is None else config.truth.model_copy(update={"seeds": scenes})
    monte_carlo = config.monte_carlo.model_copy(update={"runs": runs, "seed": seed})
    return replace(loaded, config=config.model_copy(update={"truth": truth, "monte_carlo": monte_carlo}))
