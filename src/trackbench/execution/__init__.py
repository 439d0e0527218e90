"""Where the work of a command runs: in this process, in several of this machine, or on a Dask cluster."""

from trackbench.execution.blas import one_blas_thread
from trackbench.execution.choice import executor
from trackbench.execution.serial import InProcess
from trackbench.execution.task import Here, Task

__all__ = ["Here", "InProcess", "Task", "executor", "one_blas_thread"]
