"""Motion models; ``MOTION_MODELS`` holds the models that a scenario can name."""

from trackbench.models.motion.base import (
    MOTION_MODELS,
    ConstantProcessNoise,
    InitialSigmas,
    Kinematics,
    MotionModel,
    process_noise_covariance,
)
from trackbench.models.motion.ca import ConstantAcceleration
from trackbench.models.motion.ctra import ConstantTurnRateAcceleration
from trackbench.models.motion.ctrv import ConstantTurnRateVelocity
from trackbench.models.motion.cv import ConstantVelocity

__all__ = [
    "MOTION_MODELS",
    "ConstantAcceleration",
    "ConstantProcessNoise",
    "ConstantTurnRateAcceleration",
    "ConstantTurnRateVelocity",
    "ConstantVelocity",
    "InitialSigmas",
    "Kinematics",
    "MotionModel",
    "process_noise_covariance",
]
