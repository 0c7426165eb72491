"""How many threads the linear algebra of a process takes."""

from __future__ import annotations

#: Environment of one BLAS thread a process, read when numpy is imported. The matrices are small and
#: the cores few: more threads double the processor time and save none.
ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
