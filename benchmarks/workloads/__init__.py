"""The clips that are measured: rendered ones with full truth, and recorded ones where PLANEWRIGHT_DATA is set."""

from benchmarks.workloads.recorded import recorded as recorded
from benchmarks.workloads.rendered import rendered as rendered
from benchmarks.workloads.workload import Workload as Workload
