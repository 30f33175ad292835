"""The faults of benchmarks/robustness/faults.py: what is done to runs, and how what comes of it is judged."""
