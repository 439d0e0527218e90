"""Motion models, by the short names that scenarios use."""

from trackbench.models.motion.base import InitialSigmas, Kinematics, MotionModel, process_noise
from trackbench.models.motion.ca import ConstantAcceleration
from trackbench.models.motion.constant_noise import ConstantProcessNoise
from trackbench.models.motion.ctra import ConstantTurnRateAcceleration
from trackbench.models.motion.ctrv import ConstantTurnRateVelocity
from trackbench.models.motion.cv import ConstantVelocity

#: Short name to class; each class takes its noise sigmas as keyword arguments.
MOTION_MODELS: dict[str, type[MotionModel]] = {
    "cv": ConstantVelocity,
    "ca": ConstantAcceleration,
    "ctrv": ConstantTurnRateVelocity,
    "ctra": ConstantTurnRateAcceleration,
}

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
    "process_noise",
]
