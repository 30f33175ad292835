"""What the program writes: beside what lies there already, and never in its place."""
