"""Accuracy, time and memory of the whole walk on clips with known truth. `python -m benchmarks.run`, then `python -m benchmarks.compare`."""
