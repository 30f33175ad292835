"""Tables of the pages, each made of a file in benchmarks/results/."""
