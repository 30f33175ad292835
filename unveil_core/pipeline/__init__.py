"""The stage graph, its runner and the settings of a run."""
