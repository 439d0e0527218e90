"""``import trackbench.gym`` registers ``trackbench/Tracked-v0`` with Gymnasium.

In one line: ``gymnasium.make("trackbench.gym:trackbench/Tracked-v0", env="highway-v0", tracker="gnn")``.
"""

from gymnasium.envs.registration import register, registry

from trackbench.subjects.gym.agent import IdmMobil

#: Of the environment.
ID = "trackbench/Tracked-v0"

if ID not in registry:
    register(ID, entry_point="trackbench.subjects.gym.environment:TrackedEnv")

__all__ = ["ID", "IdmMobil"]
