"""Which surfels and pixels go with the chosen objects, and what of the street behind them no frame shows."""
