import numpy as np
from bases import Imm


class Tracker(Imm):
    def weigh(self, c, fits):
        likelihood = c * np.exp(fits)
        return likelihood / likelihood.sum()
