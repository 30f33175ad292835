"""Which surfels and pixels belong to the removed objects, and which part of the street behind them no frame shows."""
