"""Time, memory and disk that a run will take on this machine, said before it starts and while it runs."""
