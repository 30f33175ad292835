"""What may be wrong with a drive that opens: told before work starts, with the likely mistake."""
