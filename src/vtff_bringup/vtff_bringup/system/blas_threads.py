"""Number of threads that the linear algebra of a process takes."""

from __future__ import annotations

#: Environment that gives each process one BLAS thread; numpy reads it when it is imported. The
#: matrices are small and the cores few: more threads double the processor time and save no time.
ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
