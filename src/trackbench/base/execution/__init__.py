"""Where the work of a command runs: in this process, in several of this machine, or on a Dask cluster."""

from trackbench.base.execution.choice import executor
from trackbench.base.execution.task import Here, InProcess, Task, one_blas_thread

__all__ = ["Here", "InProcess", "Task", "executor", "one_blas_thread"]
